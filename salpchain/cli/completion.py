"""`salpchain completion`."""

import contextlib
import io
import re
from dataclasses import dataclass, field, make_dataclass
from functools import reduce
from importlib import import_module
from operator import or_
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_type_hints

import tyro

from salpchain.checks import one_of
from salpchain.cli.options import text_option
from salpchain.errors import InputError

# In tyro's scripts, where nothing of ours fits: names of files.
FILES = '"$completions" == "__TYRO_COMPLETE_FILES__"'
FALLBACK = {
    "bash": {
        "complete -F": "complete -o default -F",
        'matches+=("$completion")': '[[ -z "$completion" ]] || matches+=("$completion")',
    },
    "zsh": {f"if [[ {FILES}": f'if [[ -z "$completions" || {FILES}'},
    "fish": {"complete --no-files": "complete"},
}
SPEC = "COMPLETION_SPEC = "
SHELLS = ("bash", "zsh", "fish")


@dataclass(frozen=True)
class Completion:
    """Print a script with which a shell completes commands and options at TAB.

    The script knows all names, so that salpchain itself is not started at TAB. Make it anew after
    an upgrade. For zsh, the folder of the file must be in fpath.

    Example: salpchain completion bash > ~/.local/share/bash-completion/completions/salpchain

    Example: salpchain completion zsh > ~/.zfunc/_salpchain

    Example: salpchain completion fish > ~/.config/fish/completions/salpchain.fish
    """

    shell: tyro.conf.Positional[Annotated[str, text_option("bash|zsh|fish")]] = ""
    """bash, zsh or fish."""


def run(options: Completion) -> None:
    """Prints the script."""
    if not options.shell:
        known = f"{', '.join(SHELLS[:-1])} or {SHELLS[-1]}"
        raise InputError(f"salpchain completion needs a shell: {known}")
    one_of("shell", options.shell, SHELLS)
    print(script(options.shell), end="")


def script(shell: str) -> str:
    """The completion script for a shell, as tyro writes it for all commands together."""
    said = io.StringIO()
    words = ["--tyro-print-completion", shell]
    with contextlib.redirect_stdout(said), contextlib.suppress(SystemExit):
        tyro.cli(
            _all_commands(), prog="salpchain", args=words, config=(tyro.conf.FlagCreatePairsOff,)
        )
    text = said.getvalue()
    for theirs, ours in FALLBACK[shell].items():
        text = text.replace(theirs, ours)
    lines = text.splitlines()  # that of the names has descriptions with breaks in them
    return "\n".join(x.replace(r"\n", " ") if x.startswith(SPEC) else x for x in lines) + "\n"


def _all_commands() -> Any:
    from salpchain.cli.main import COMMANDS, with_quiet

    kinds: list[Any] = []
    for name, (kind, about) in COMMANDS.items():
        options = _completed(with_quiet(getattr(import_module(f"salpchain.cli.{name}"), kind)))
        kinds.append(Annotated[options, tyro.conf.subcommand(name, description=about)])
    return reduce(or_, kinds)


def _completed(kind: Any) -> Any:
    """Options of which what stands for them says how they are completed: files, or a choice."""
    narrow: list[Any] = []
    for name, hint in get_type_hints(kind, include_extras=True).items():
        how = _how(next((x.metavar for x in get_args(hint) if hasattr(x, "metavar")), None) or "")
        if how is not None and get_args(hint)[0] is str:
            default = Path() if how is Path else get_args(how)[0]
            narrow.append((name, Annotated[how, *get_args(hint)[1:]], field(default=default)))
    return make_dataclass(kind.__name__, narrow, bases=(kind,), frozen=True)


def _how(metavar: str) -> Any:
    if any(word in metavar for word in ("FOLDER", "FILE", "POLICY")):
        return Path
    return Literal[*metavar.split("|")] if re.fullmatch(r"[a-z-]+(\|[a-z-]+)+", metavar) else None
