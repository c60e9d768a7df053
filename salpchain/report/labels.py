"""What results are called side by side: by their names, by their folders where names meet."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from salpchain.errors import InputError
from salpchain.files import StrPath


def labels(names: Sequence[str], folders: Sequence[StrPath]) -> list[str]:
    """The name of each, or, where several have one name, the shortest path that tells them apart.

    No two labels are alike unless two folders are.
    """
    count = Counter(names)
    told = list(names)
    for name in (name for name in count if count[name] > 1):
        places = [place for place, other in enumerate(names) if other == name]
        for place, path in zip(places, distinguishing([folders[i] for i in places]), strict=True):
            told[place] = path
    again = Counter(told)
    told = [
        str(folder) if again[label] > 1 else label
        for label, folder in zip(told, folders, strict=True)
    ]
    return [f" {label}" if label.startswith("_") else label for label in told]  # else not drawn


def distinguishing(paths: Sequence[StrPath]) -> list[str]:
    """Each path without what all of them begin with, and without what all of them end in."""
    parts = [Path(path).absolute().parts for path in paths]
    first = _alike(parts)
    last = _alike([tuple(reversed(one[first:])) for one in parts])
    return [str(Path(*one[first : len(one) - last])) for one in parts]


def _alike(rows: Sequence[Sequence[str]]) -> int:
    """How many parts all rows begin with, at least one of each left over."""
    most = min(map(len, rows)) - 1
    pairs = list(zip(*rows, strict=False))[:most]
    return next((place for place, parts in enumerate(pairs) if len(set(parts)) > 1), len(pairs))


def check_once(paths: Sequence[StrPath]) -> None:
    """Raise InputError if two paths lead to the same place."""
    met: set[Path] = set()
    for path in map(Path, paths):
        if path.resolve() in met:
            raise InputError(f"{path} is given twice: leave one out")
        met.add(path.resolve())
