"""The grid of a study: which controllers are trained, with which seeds, and how they are tested.

Imports neither JAX nor pandas, so that a plan is printed at once.
"""

import dataclasses
import json
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from salpchain.checks import check_length, one_of
from salpchain.errors import InputError
from salpchain.files import LOCK_FILE, StrPath, read_json, write_json
from salpchain.networks.config import PAPER_GRAPHS, SINGLE_LENGTH
from salpchain.tasks.config import TIME_LIMITS
from salpchain.training.config import TrainConfig
from salpchain.training.presets import PRESETS, choose
from salpchain.training.settings import laid_over, typed

DISABLED = "disabled"  # folder of the experiment of that name
GRID_FILE = "grid.json"
FORMAT = 1
PAPER_MODELS = ("mlp", "gcn", "gatv2", "gt")
PAPER_LENGTHS = (8, 16)
PAPER_TESTS = tuple(range(4, 65, 4))
PAPER_TRIALS = 50
PAPER_SEEDS = 5
TEST_SEED = 1000  # of the starts that judge (chosen)
_NO_MIX = "each of its controllers is trained on one length"
# Settings that the study itself varies or fixes, and what to do instead.
VARIED = {
    "preset": "give it as preset",
    "control.model": "give it as models",
    "control.graph": "give it as graphs",
    "task.length": "give it as lengths",
    "seed": "give it as seeds",
    "steps": "give it as steps",
    "mix.lengths": _NO_MIX,
    "mix.weights": _NO_MIX,
    "mix.grow": _NO_MIX,
    "name": "each run is named by its settings",
}
MOST_SEEDS = 1000  # (chosen)


@dataclass(frozen=True)
class Job:
    """One training run and its tests."""

    config: TrainConfig
    tests: dict[str, tuple[int, ...]]  # lengths by time limit

    @property
    def name(self) -> str:
        """The name of its folder: the configuration, then the seed."""
        return f"{self.config.policy_name}/seed-{self.config.seed}"


@dataclass(frozen=True)
class Grid:
    """Every model on every graph at every training length, with several seeds.

    Raises:
        InputError: unknown or repeated values, or impossible combinations.
    """

    preset: str = "quick"
    models: tuple[str, ...] = PAPER_MODELS
    graphs: tuple[str, ...] = PAPER_GRAPHS
    lengths: tuple[int, ...] = PAPER_LENGTHS
    seeds: int = PAPER_SEEDS
    steps: int | None = None  # of each run; None: the preset's
    trials: int = PAPER_TRIALS
    tests: tuple[int, ...] = PAPER_TESTS
    time_limits: tuple[str, ...] = TIME_LIMITS
    settings: tuple[str, ...] = ()  # of every run, otherwise than the preset's: PATH=VALUE, sorted

    def __post_init__(self) -> None:
        one_of("preset", self.preset, PRESETS)
        _check_each("model", self.models, PAPER_MODELS)
        _check_each("time limit", self.time_limits, TIME_LIMITS)
        _check_once("length", self.lengths)
        for length in (*self.lengths, *self.tests):
            check_length(length)
        if not 1 <= self.seeds <= MOST_SEEDS:
            raise InputError(f"seeds must be 1 to {MOST_SEEDS}, got {self.seeds}")
        if any(model not in SINGLE_LENGTH for model in self.models):
            _check_each("graph", self.graphs, PAPER_GRAPHS)
        else:
            self._check_without_graphs()
        self._check_settings()

    def _check_settings(self) -> None:
        for path in typed(self.settings):
            if path in VARIED:
                raise InputError(f"a study has a setting {path} of its own: {VARIED[path]}")
        if list(self.settings) != sorted(self.settings):
            raise InputError(f"settings must be sorted, got {', '.join(self.settings)}")
        if self.settings:
            self.configurations()

    def _check_without_graphs(self) -> None:
        if self.graphs:
            raise InputError(
                f"an {self.models[0]} has no graph, got {', '.join(self.graphs)}: add a graph model"
                " or leave the graphs out"
            )
        odd = ", ".join(str(length) for length in self.tests if length not in self.lengths)
        if odd:
            raise InputError(
                f"an {self.models[0]} works at its training length only, got tests at {odd}: add a"
                " graph model or leave the tests out"
            )

    @property
    def changed_preset(self) -> str:
        """The preset, and what was set otherwise."""
        return " with ".join([self.preset, *([", ".join(self.settings)] if self.settings else [])])

    def configurations(self) -> list[TrainConfig]:
        """The configurations of all runs, with seed 0; those with one length have no graph."""
        return [
            self._config(model, graph, length)
            for length in self.lengths
            for model in self.models
            for graph in (self.graphs if model not in SINGLE_LENGTH else (None,))
        ]

    def _config(self, model: str, graph: str | None, length: int) -> TrainConfig:
        config = choose(self.preset, model=model, graph=graph, length=length, steps=self.steps)
        return laid_over(config, typed(self.settings))

    def jobs(self) -> list[Job]:
        """All runs: first every configuration with seed 0, then with seed 1, and so on.

        So a study that is stopped half way has something to say about every configuration.
        """
        return [
            Job(dataclasses.replace(config, seed=seed), self._tests_of(config))
            for seed in range(self.seeds)
            for config in self.configurations()
        ]

    def _tests_of(self, config: TrainConfig) -> dict[str, tuple[int, ...]]:
        own = config.control.model in SINGLE_LENGTH
        lengths = (config.task.length,) if own else self.tests
        return dict.fromkeys(self.time_limits, lengths)


def _check_each(what: str, given: Sequence[str], known: Collection[str]) -> None:
    for name in given:
        one_of(what, name, known)
    _check_once(what, given)


def _check_once(what: str, given: Sequence[Any]) -> None:
    if not given:
        raise InputError(f"a grid needs at least one {what}")
    for value in given:
        if given.count(value) > 1:
            raise InputError(f"{what} {value} is in the grid twice")


def check_folder(folder: StrPath, grid: Grid) -> None:
    """That this grid may be done in the folder: new, empty, or one in which it was begun.

    More seeds than were begun with are the same grid, grown.

    Raises:
        InputError: the folder holds another grid, or something else.
    """
    folder = Path(folder)
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is a file: a study needs a folder")
    if (folder / GRID_FILE).exists():
        _check_same(folder, grid)
    elif folder.is_dir() and any(not _is_ours(path) for path in folder.iterdir()):
        raise InputError(f"{folder} holds something else than a study: choose another --out")


def _is_ours(path: Path) -> bool:
    """Whether it may lie where no study has begun: what is left of one that failed, or a test."""
    return path.name in (LOCK_FILE, DISABLED) or path.name.startswith(f".{GRID_FILE}")


def claim(folder: StrPath, grid: Grid) -> None:
    """Makes the folder that of this grid.

    Raises:
        InputError: as `check_folder`.
    """
    check_folder(folder, grid)
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    if not (folder / GRID_FILE).exists() or read_grid(folder) != grid:
        write_json(folder / GRID_FILE, {"format": FORMAT, "grid": dataclasses.asdict(grid)})


def read_grid(folder: StrPath) -> Grid:
    """The grid of a study.

    Raises:
        InputError: the folder is none, or its grid is not understood.
    """
    folder = Path(folder)
    if not (folder / GRID_FILE).is_file():
        raise InputError(f"{folder} is not the folder of a study: it has no {GRID_FILE}")
    content = read_json(folder / GRID_FILE)
    names = {field.name for field in dataclasses.fields(Grid)}
    try:
        if int(content["format"]) > FORMAT:
            raise InputError(f"{folder} was made by a newer salpchain: upgrade salpchain")
        given: dict[str, Any] = {"settings": [], **content["grid"]}  # older ones have none
        if given.keys() != names:
            odd = sorted(given.keys() ^ names)[0]
            raise ValueError(f"{odd!r} is {'unknown' if odd in given else 'missing'}")
        values: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in given.items()
        }
        return Grid(**values)
    except InputError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(
            f"{folder / GRID_FILE} does not describe a grid ({type(error).__name__}: {error}):"
            " restore it, or choose another folder"
        ) from None


def _check_same(folder: Path, grid: Grid) -> None:
    begun = dataclasses.asdict(read_grid(folder))
    for name, value in dataclasses.asdict(grid).items():
        grown = name == "seeds" and value > begun[name]
        if begun[name] != value and not grown:
            has, given = (json.dumps(x) for x in (begun[name], value))
            raise InputError(
                f"{folder} holds another grid: {name.replace('_', ' ')} {has} there, {given}"
                " given; repeat its options, or choose another --out"
            )
