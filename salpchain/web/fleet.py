"""The policies that a live page can choose from: hand-written, released, and runs in a folder."""

from pathlib import Path

from salpchain.controllers import named
from salpchain.controllers.named import WRITTEN, check_live, check_there, is_name, is_own
from salpchain.controllers.policy import Controller
from salpchain.controllers.released import PAPER_DYNAMICS, released
from salpchain.controllers.storage import POLICY_FILE, load
from salpchain.errors import InputError
from salpchain.files import StrPath

QUICK = [name for name, written in WRITTEN.items() if written.live]
SPARE = "greedy"  # steers if the first policy cannot
# Released policies that steer first if there are any, best first
BEST = ("any-water", "any-length")
MOST = 200  # policies in the list (chosen)


class Fleet:
    """Policies by name. Only what is in the list can be loaded, never a path from outside."""

    def __init__(self, chosen: str = "", runs: StrPath | None = None) -> None:
        """The policy that the user chose (a name or a path) and those in a folder of runs.

        Raises:
            InputError: the chosen one is neither a name, nor a run folder, nor a policy file, or
                too slow to steer while a person watches.
        """
        self._paths = released(PAPER_DYNAMICS)  # the page shows no other chains
        self._paths |= _runs_in(Path(runs)) if runs else {}
        best = [name for name in BEST if name in self._paths]
        self.first = best[0] if best else next(iter(self._paths), "approach")
        self._loaded: dict[str, Controller] = {}
        if is_name(chosen):
            check_live(chosen)
            self.first = chosen
        elif is_own(chosen):
            self._loaded[chosen] = named.load(chosen)
            self.first = chosen
        elif chosen:
            self._add(chosen)

    def _add(self, chosen: str) -> None:
        check_there(chosen)
        path = Path(chosen)
        policy, name = load(path), path.name if path.is_dir() else path.stem
        listed = [
            known for known, other in self._paths.items() if other.resolve() == path.resolve()
        ]
        free = name not in (*WRITTEN, *self._paths)
        self.first = listed[0] if listed else name if free else str(path.resolve())
        self._paths[self.first], self._loaded[self.first] = path, policy

    @property
    def names(self) -> list[str]:
        """All policies, the one that steers first in front."""
        every = dict.fromkeys((*self._paths, *self._loaded, *QUICK))
        others = [name for name in every if name != self.first]
        return [self.first, *others][:MOST]

    def load(self, name: str) -> Controller:
        """The policy of this name; read from its file once.

        Raises:
            InputError: none of that name, or its file is damaged.
        """
        if name not in self._loaded:
            if name not in self.names:
                raise InputError(f"there is no policy {name!r}: choose one of the list")
            path = self._paths.get(name)
            self._loaded[name] = load(path) if path else named.load(name)
        return self._loaded[name]


def _runs_in(folder: Path) -> dict[str, Path]:
    """Runs of a folder, or in the folders within it, by their path inside.

    One that is called as a controller of the package is listed with the folder before it.
    """
    found = sorted((*folder.glob(f"*/{POLICY_FILE}"), *folder.glob(f"*/*/{POLICY_FILE}")))
    inside = [(str(path.parent.relative_to(folder)), path.parent) for path in found[:MOST]]
    return {str(path) if is_name(name) else name: path for name, path in inside}
