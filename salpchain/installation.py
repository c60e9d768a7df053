"""How this copy of the package was installed, so that a message names a command that works."""

import json
import shlex
import shutil
import sys
from importlib.metadata import PackageNotFoundError, distribution
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import unquote, urlsplit

NAME = "salpchain"


def install_command(extra: str) -> str:
    """The command that adds an extra to this installation: for a clone, a wheel or an index."""
    return f"{_installer()} {_wanted(extra)}"


def program() -> str:
    """What to type here to start the command line: `salpchain` if the shell finds this one."""
    script = Path(sys.executable).with_name(NAME)
    found = shutil.which(NAME)
    if found is not None and Path(found).absolute() == script:
        return NAME
    if not script.exists():
        return f"{_quoted(Path(sys.executable))} -m {NAME}"
    return _quoted(script)


def _quoted(path: Path) -> str:
    """The path, from here where that is shorter."""
    here = Path.cwd()
    return shlex.quote(str(path.relative_to(here) if path.is_relative_to(here) else path))


def _installer() -> str:
    """The installer of this environment, which the shell's `pip` need not be."""
    if find_spec("pip") is None and shutil.which("uv"):
        return f"uv pip install --python {_quoted(Path(sys.executable))}"
    found = shutil.which("pip")
    if found is not None and Path(found).absolute().parent == Path(sys.executable).parent:
        return "pip install"
    return f"{_quoted(Path(sys.executable))} -m pip install"


def _wanted(extra: str) -> str:
    """The package with the extra, from where this one came."""
    came = _came_from()
    url = came.get("url", "")
    if "dir_info" in came or not url:
        folder = Path(unquote(urlsplit(url).path)) if url else None
        if folder is None or not (folder / "pyproject.toml").exists():
            return shlex.quote(f"{NAME}[{extra}]")
        editable = "--editable " if came["dir_info"].get("editable") else ""
        return f"{editable}{shlex.quote(f'{folder}[{extra}]')}"
    source = came.get("vcs_info")
    if source is not None:
        url = f"{source['vcs']}+{url}@{source['commit_id']}"
    return shlex.quote(f"{NAME}[{extra}] @ {url}")


def _came_from() -> dict:
    """What the installer noted (PEP 610); nothing for an index."""
    try:
        noted = distribution(NAME).read_text("direct_url.json")
    except PackageNotFoundError:  # run from a copy of the repository
        root = Path(__file__).parent.parent
        return {"url": root.as_uri(), "dir_info": {"editable": True}}
    try:
        return json.loads(noted) if noted else {}
    except json.JSONDecodeError:
        return {}
