"""Policies that come with the package. Imports nothing heavy: the command line asks it."""

from importlib.resources import files
from pathlib import Path

FOLDER = Path(str(files("salpchain"))) / "policies"


def released() -> dict[str, Path]:
    """Their files by name; none where the package has no such folder."""
    return {path.stem: path for path in sorted(FOLDER.glob("*.safetensors"))}
