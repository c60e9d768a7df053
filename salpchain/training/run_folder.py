"""The folder of one training run: its settings, its log, its checkpoint, its policy.

Imports neither JAX nor pandas, so that bad input is refused at once.
"""

import csv
import dataclasses
import io
import platform
from collections.abc import Set
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, get_type_hints

from salpchain.errors import InputError
from salpchain.files import LOCK_FILE, StrPath, read_json, write_json, write_text
from salpchain.ranges import Range, as_range
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.registry import config_class
from salpchain.training.config import TrainConfig
from salpchain.training.settings import changed, part_of

CONFIG_FILE = "config.json"
METRICS_FILE = "metrics.csv"
EVALUATIONS_FILE = "evaluations.csv"
SUMMARY_FILE = "summary.json"
FORMAT = 1
NEEDED = {"iteration", "steps", "seconds", "episodes", "success", "closed_fraction"}
EVALUATED = {"iteration", "steps", "trials", "success", "closed_fraction"}
PACKAGES = ("salpchain", "jax", "jaxlib", "equinox", "optax", "numpy")


def create(run: StrPath, config: TrainConfig, devices: int, device: str) -> None:
    """A new run folder with the run's settings.

    Raises:
        InputError: the folder holds something already.
        OSError: it cannot be made or written.
    """
    check_free(run)
    run = Path(run)
    run.mkdir(parents=True, exist_ok=True)
    write_json(run / CONFIG_FILE, describe(config, devices, device))


def check_free(run: StrPath) -> None:
    """Raise InputError unless a new run may use this folder.

    Raises:
        InputError: it is a file, or holds something already.
    """
    run = Path(run)
    if run.exists() and not run.is_dir():
        raise InputError(f"{run} is a file: a run needs a folder")
    if not is_free(run):
        python = f"salpchain.resume({str(run)!r}) goes on with it, or choose another folder"
        shell = "add --resume to go on with it, or choose another --out"
        raise InputError(f"{run} is already used: ", python=python, shell=shell)


def is_free(run: StrPath) -> bool:
    """Whether there is no such folder, or one that is empty but for a half-written start."""
    run, start = Path(run), (f".{CONFIG_FILE}", LOCK_FILE)
    return not run.exists() or all(p.name.startswith(start) for p in run.iterdir())


def is_finished(run: StrPath) -> bool:
    """Whether the run came to its end: its summary is written last."""
    return (Path(run) / SUMMARY_FILE).exists()


def describe(config: TrainConfig, devices: int, device: str) -> dict[str, Any]:
    """Every setting, those changed from the preset, versions and device, as plain JSON values."""
    return {
        "format": FORMAT,
        "config": dataclasses.asdict(config),
        "changed": changed(config),
        "devices": devices,
        "device": device,
        "python": platform.python_version(),
        "versions": {name: _version(name) for name in PACKAGES},
    }


def change_devices(run: StrPath, devices: int, device: str) -> None:
    """Notes in the settings of a run that it goes on over other devices."""
    path = Path(run) / CONFIG_FILE
    write_json(path, {**read_json(path), "devices": devices, "device": device})


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


def check_run(run: StrPath) -> Path:
    """The folder of a run.

    Raises:
        InputError: there is no such folder, or it is that of no run.
    """
    run, right = Path(run), "give the folder that a training wrote"
    if not run.exists():
        raise InputError(f"no such run folder: {run} ({right})")
    if not (run / CONFIG_FILE).is_file():
        raise InputError(f"{run} is not a run folder: it has no {CONFIG_FILE} ({right})")
    return run


def read_config(run: StrPath) -> tuple[TrainConfig, int]:
    """The settings of a run, and over how many devices its chains are shared out.

    Raises:
        InputError: the folder is no run folder, or its settings are not understood.
    """
    run = check_run(run)
    content = read_json(run / CONFIG_FILE)
    try:
        if content["format"] > FORMAT:
            raise InputError(f"{run} was made by a newer salpchain: upgrade salpchain")
        config, devices = train_config(content["config"]), content["devices"]
        if type(devices) is not int or devices < 1:
            raise TypeError(f"devices is {devices!r}")
        if not isinstance(content["device"], str):
            raise TypeError(f"device is {content['device']!r}")
    except (KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{run / CONFIG_FILE} does not describe a run ({error})") from None
    return config, devices


def train_config(values: dict[str, Any]) -> TrainConfig:
    """The settings from plain values; unknown ones are refused.

    One that is missing came with a later version, and has its default: what was done before.
    """
    return _built(TrainConfig, {"mix": {}, **values})


def _built(kind: Any, values: dict[str, Any], above: str = "") -> Any:
    """A dataclass of settings from plain values, and those within it; `above` is its path."""
    kinds = get_type_hints(kind)
    odd = values.keys() - kinds.keys()
    if odd:
        raise TypeError(f"{sorted(odd)[0]!r} is unknown")
    built = {name: _value(kinds[name], value, name) for name, value in values.items()}
    with part_of(above):
        return kind(**built)


def _value(kind: Any, value: Any, name: str) -> Any:
    if kind is TaskConfig:
        kind = config_class(value.get("name", TaskConfig.name))
    if dataclasses.is_dataclass(kind):
        return _built(kind, value, name)
    if kind is Range:
        return as_range(value)
    return tuple(value) if isinstance(value, list) else value


class MetricsLog:
    """`metrics.csv`, a row for each iteration, and the same as TensorBoard scalars."""

    def __init__(self, run: StrPath, keep: int) -> None:
        """Opens the log of a run, with its rows up to iteration `keep` and no later ones."""
        from tensorboardX import SummaryWriter

        self.path = Path(run) / METRICS_FILE
        self.rows = [row for row in read_log(run) if int(row["iteration"]) <= keep]
        if self.path.exists():
            write_text(self.path, _as_csv(self.rows))
        self._file = self.path.open("a", encoding="utf-8", newline="")
        self._board = SummaryWriter(str(Path(run) / "tensorboard"), purge_step=keep + 1)

    def add(self, row: dict[str, float]) -> None:
        """One more iteration, on disk at once; no number is an empty cell."""
        writer = csv.DictWriter(self._file, row)
        if not self.rows:
            writer.writeheader()
        text = {name: _cell(value) for name, value in row.items()}
        writer.writerow(text)
        self._file.flush()
        self.rows.append(text)
        self.board(int(row["iteration"]), row)

    def board(self, iteration: int, values: dict[str, float]) -> None:
        """TensorBoard scalars of an iteration; what is no number is left out."""
        for name, value in values.items():
            if value == value:
                self._board.add_scalar(name, value, iteration)

    def close(self) -> None:
        """Flushes both."""
        self._file.close()
        self._board.close()


class EvaluationLog:
    """`evaluations.csv`: a row for each evaluation of a training and each of its lengths."""

    def __init__(self, run: StrPath, keep: int) -> None:
        """Goes on with the rows up to iteration `keep`; later ones come again."""
        self.path = Path(run) / EVALUATIONS_FILE
        self.rows = [row for row in _read_rows(self.path) if int(row["iteration"]) <= keep]

    def add(self, rows: list[dict[str, float]]) -> None:
        """One more evaluation, on disk at once; one of the same iteration is replaced."""
        text = [{name: _cell(value) for name, value in row.items()} for row in rows]
        now = text[0]["iteration"]
        self.rows = [row for row in self.rows if row["iteration"] != now] + text
        write_text(self.path, _as_csv(self.rows))


def _cell(value: int | float) -> str:
    return "" if value != value else f"{value:.7g}"


def read_log(run: StrPath, remedy: str = ": delete it to go on") -> list[dict[str, str]]:
    """The rows of a run's log; none where it has not begun. A last row cut short is left out.

    Raises:
        InputError: it is no such log; the message ends with the remedy.
    """
    return _read_rows(Path(run) / METRICS_FILE, NEEDED, remedy)


def read_evaluations(run: StrPath) -> list[dict[str, str]]:
    """The rows of a run's evaluations; none before the first.

    Raises:
        InputError: the file is no such table.
    """
    return _read_rows(Path(run) / EVALUATIONS_FILE, EVALUATED, remedy="")


def _read_rows(
    path: Path, needed: Set[str] = frozenset({"iteration"}), remedy: str = ": delete it to go on"
) -> list[dict[str, str]]:
    """The rows of a table of numbers, none where there is no file; one cut short is left out."""
    if not path.exists():
        return []
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = [row for row in csv.DictReader(file) if None not in row.values()]
        for row in rows:
            missing = needed - row.keys()
            if missing:
                raise ValueError(f"no column {sorted(missing)[0]!r}")
            _ = [float(cell or "nan") for cell in row.values()], int(row["iteration"])
    except (TypeError, ValueError, csv.Error) as error:
        raise InputError(f"{path} is not a log of a run ({error}){remedy}") from None
    return rows


def _as_csv(rows: list[dict[str, str]]) -> str:
    text = io.StringIO(newline="")
    if rows:
        writer = csv.DictWriter(text, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    return text.getvalue()
