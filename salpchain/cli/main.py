"""The command `salpchain`: finds the subcommand, reads its options, prints errors as one line."""

import contextlib
import difflib
import errno
import io
import re
import sys
import textwrap
from dataclasses import field, make_dataclass
from importlib import import_module
from itertools import pairwise
from typing import Annotated, Any

from salpchain import __version__
from salpchain.cli import jax_start, streams
from salpchain.compilation_cache import use_cache
from salpchain.errors import InputError

COMMANDS = {
    "train": ("Train", "train one controller on chains of one or many lengths"),
    "evaluate": ("Evaluate", "test a policy, unchanged, on chains of many lengths"),
    "figure": ("Figure", "draw learning curves or zero-shot curves"),
    "export": ("Export", "write a policy as one file for ONNX runtimes or PyTorch"),
    "models": ("Models", "list the controllers and their parameter counts"),
    "best": ("Best", "show, check and better the best-known solutions of fixed starts"),
    "bench": ("Bench", "measure the speed of physics and environment on this machine"),
    "reproduce": ("Reproduce", "repeat the paper: the whole study, its figures and a report"),
    "rollout": ("Rollout", "record one episode, every body at every step"),
    "video": ("Video", "draw swims as a video or a strip of moments"),
    "replay": ("Replay", "write swims as one page to play in a browser"),
    "live": ("Live", "steer a chain yourself in the browser, while it swims"),
    "completion": ("Completion", "print a script for TAB in bash, zsh or fish"),
    "demo": ("Demo", "train, test and draw in one go: what `make demo` runs"),
}

# What would be right, by what the system refused.
ADVICE = {
    errno.ENOSPC: " (free some space, then try again)",
    errno.EDQUOT: " (free some space, then try again)",
    **dict.fromkeys(
        (errno.EEXIST, errno.ENOTDIR), " (a file is in the way: choose another folder)"
    ),
    **dict.fromkeys(
        (errno.ENOENT, errno.EACCES, errno.EPERM, errno.EROFS),
        " (choose a folder that can be written)",
    ),
}

# What a command needs, [what it may be given], and ... what repeats.
USAGE = {
    "train": "--out FOLDER [--set PATH=VALUE]... [OPTIONS]",
    "evaluate": "RUN_OR_POLICY [OPTIONS]",
    "figure": "learning|zero-shot FOLDER... [OPTIONS]",
    "export": "POLICY [OPTIONS]",
    "models": "[NAME] [OPTIONS]",
    "best": "[--check|--play LENGTH START|--add FILE.npz] [OPTIONS]",
    "bench": "[OPTIONS]",
    "reproduce": "[--set PATH=VALUE]... [OPTIONS]",
    "rollout": "RUN_OR_POLICY --out FILE.npz [OPTIONS]",
    "video": "POLICY_OR_TRAJECTORY|--compare A B... --out FILE.mp4|gif|png [OPTIONS]",
    "replay": "POLICY_OR_FILE... --out FILE.html [OPTIONS]",
    "live": "[RUN_OR_POLICY] [OPTIONS]",
    "completion": "bash|zsh|fish",
    "demo": "[--set PATH=VALUE]... [OPTIONS]",
}

WIDTH = 79  # columns of a page of help

HELP = """usage: salpchain COMMAND [OPTIONS]

Simulate chains of salp-inspired swimming units, and train one controller that steers a chain
of any length.

commands:
{commands}

options:
  --help, -h   this page; `salpchain COMMAND --help` is the page of a command
  --version    the version

environment:
  SALPCHAIN_CACHE   off, or a folder: where compiled programs are kept (else the user's cache)
  JAX_PLATFORMS     cpu, cuda, ...: what JAX computes on

example:
  salpchain train --length 8 --out runs/eight
  salpchain evaluate runs/eight --lengths 4:64:4 --out results/eight
  salpchain figure zero-shot results/eight --out figures/zero-shot.png
"""


def main() -> None:
    """Runs the command line of this process and exits: 0 done, 2 bad input, 130 interrupted."""
    results = streams.install()
    sys.exit(streams.close(results, run(sys.argv[1:])))


def run(arguments: list[str]) -> int:
    """Runs a command line; returns the exit status."""
    try:
        return _dispatch(arguments)
    except KeyboardInterrupt:
        print("salpchain: interrupted", file=sys.stderr)
        return 130
    except InputError as error:
        return _fail(error.typed)
    except OSError as error:
        where = f": {error.filename}" if error.filename else ""
        advice = ADVICE.get(error.errno or 0, "")
        return _fail(f"{(error.strerror or str(error)).lower()}{where}{advice}")
    except Exception:
        if reason := jax_start.why_it_fails():
            return _fail(reason)
        raise


def _dispatch(arguments: list[str]) -> int:
    if not arguments or arguments[0] in ("--help", "-h", "help"):
        print(_help())
        return 0
    if arguments[0] == "--version":
        print(f"salpchain {__version__}")
        return 0
    name, *rest = arguments
    if name not in COMMANDS:
        raise InputError(
            f"unknown command {name!r}: choose one of {', '.join(COMMANDS)}{_close(name, COMMANDS)}"
        )
    _check_filled(name, rest)
    module = import_module(f"salpchain.cli.{name}")
    options = _read(getattr(module, COMMANDS[name][0]), name, rest)
    if options is None:
        return 0
    streams.set_quiet(options.quiet)
    jax_start.check_flags()
    use_cache()
    return module.run(options) or 0


def _check_filled(name: str, arguments: list[str]) -> None:
    """Raise InputError if an argument is empty: it would be taken for a missing option.

    Raises:
        InputError: one is empty.
    """
    for before, given in pairwise(("", *arguments)):
        option = before if before.startswith("--") else "an argument"
        if given.startswith("--") and given.endswith("="):
            option, given = given[:-1], ""
        if not given:
            raise InputError(
                f"salpchain {name}: {option} is empty: give it a value or leave it out"
            )


def _help() -> str:
    lines = (f"  {name:<10} {text}" for name, (_, text) in COMMANDS.items())
    return HELP.format(commands="\n".join(lines)).rstrip()


def _read(kind: Any, name: str, arguments: list[str]) -> Any:
    """The options of a command, or None after printing its help.

    Raises:
        InputError: an unknown option, or one without its value.
    """
    import tyro

    kind = with_quiet(kind)
    page = io.TextIOWrapper(io.BytesIO(), encoding=sys.stdout.encoding, errors="replace")
    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(page), contextlib.redirect_stderr(said):
            options, odd = tyro.cli(
                kind,
                prog=f"salpchain {name}",
                args=arguments,
                return_unknown_args=True,
                config=(tyro.conf.FlagCreatePairsOff,),
            )
    except SystemExit as stop:
        if not stop.code:
            page.seek(0)
            print(_with_usage(name, _wrapped(page.read())))
            return None
        raise InputError(f"salpchain {name}: {_one_line(said.getvalue())}") from None
    if odd:
        names = [f"--{field}".replace("_", "-") for field in kind.__dataclass_fields__]
        raise InputError(f"salpchain {name}: unknown argument {odd[0]!r}{_close(odd[0], names)}")
    return options


def with_quiet(kind: Any) -> Any:
    """The options of a command, and `--quiet`, which all have."""
    from tyro.conf import arg

    about = "No progress and no notices: results and errors alone."
    quiet = "quiet", Annotated[bool, arg(help=about, help_behavior_hint="")], field(default=False)
    with_quiet = make_dataclass(kind.__name__, [quiet], bases=(kind,), frozen=True)
    with_quiet.__doc__ = kind.__doc__
    return with_quiet


def _with_usage(name: str, page: str) -> str:
    """The page with its first paragraph replaced by the command's line of usage."""
    _, _, rest = page.partition("\n\n")
    return f"usage: salpchain {name} {USAGE[name]}\n\n{rest}"


def _wrapped(page: str) -> str:
    """The page with long lines of text broken; examples stay whole, to be copied."""

    def wrapped(line: str) -> str:
        text = line[:1].isalnum() and not line.startswith("Example")
        return textwrap.fill(line, WIDTH) if text else line

    return "\n".join(map(wrapped, page.splitlines()))


def _one_line(box: str) -> str:
    """The first sentence of a boxed error message."""
    lines = [re.sub(r"[│╭╮╰╯─]", " ", line).strip() for line in box.splitlines()]
    text = " ".join(line for line in lines[1:] if line)
    return re.sub(r"\s+", " ", re.split(r"For full helptext|Argument helptext|Got errors", text)[0])


def _close(name: str, known: Any) -> str:
    bare = {one.lstrip("-"): one for one in known}  # dashes alone are not near
    near = difflib.get_close_matches(name.lstrip("-"), bare, n=1)
    return f" (perhaps {bare[near[0]]})" if near else ""


def _fail(message: str) -> int:
    print(f"salpchain: error: {' '.join(message.split())}", file=sys.stderr)
    return 2


if __name__ == "__main__":
    main()
