"""`--set` and `--config`: any setting of a training from the command line or a file."""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import tyro

from salpchain.cli.options import text_option
from salpchain.errors import InputError
from salpchain.evaluation.config import lengths_as_text
from salpchain.files import read_json
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.registry import configured
from salpchain.training.config import CUSTOM, TrainConfig
from salpchain.training.run_folder import CONFIG_FILE, FORMAT, check_run
from salpchain.training.settings import (
    SETTINGS,
    SHORT,
    check_path,
    checked,
    compose,
    flat,
    laid_over,
    overlay,
    task_of,
    typed,
)
from salpchain.world.config import WorldConfig

Sets = Annotated[tuple[str, ...], tyro.conf.UseAppendAction, text_option("PATH=VALUE", name="set")]
File = Annotated[str, text_option("FILE")]


# What other files of the package hold, by a name that is no setting's
OTHERS = {"trials": "the result of an evaluation", "lengths": "the result of an evaluation"}
OTHERS |= {"in_training": "the summary of a run", "evaluation": "the summary of a run"}
OTHERS |= {"measured": "a model card"}
RIGHT = "give a run's config.json or its folder, or a TOML with tables such as task and ppo"


def read_settings(name: str) -> dict[str, Any]:
    """The settings in a file, by path: a run's `config.json` (or the run's folder), or a TOML.

    A file of a run has all of them; one that came with a later version has its default.

    Raises:
        InputError: no such file, not such a file, an unknown setting, or a value of another type.
    """
    path = check_run(name) / CONFIG_FILE if Path(name).is_dir() else Path(name)
    content = _toml(path) if path.suffix == ".toml" else _json(path)
    if not isinstance(content, dict):
        raise InputError(f"{path} holds no settings: {RIGHT}")
    of_run = "config" in content
    if what := next((what for key, what in OTHERS.items() if key in content and not of_run), ""):
        raise InputError(f"{path} is {what}, not settings: {RIGHT}")
    if of_run:
        _check_format(content.get("format"), path)
        content = content["config"]
    try:
        flattened = _flattened(content)
        task = task_of(flattened)
        values = {path: checked(path, value, task) for path, value in flattened.items()}
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return {**flat(compose({"preset": CUSTOM, "task.name": task})), **values} if of_run else values


def _json(path: Path) -> Any:
    try:
        return read_json(path)
    except InputError as error:
        remedy = f": {RIGHT}" if path.exists() else ""
        raise InputError(f"{error}{remedy}") from None


def _toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"no such file: {path}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path} is not valid TOML ({error})") from None


def _check_format(version: Any, path: Path) -> None:
    if type(version) is not int or version > FORMAT:
        raise InputError(f"{path} was made by a newer salpchain: upgrade salpchain")


# Settings of the task that the policy and other options say
FIXED = {f"task.{name}" for name in ("name", "length", "observation", "action", "time_limit")}
TABLES = {path[:i] for path in SETTINGS for i, letter in enumerate(path) if letter == "."}


def _flattened(content: Any, above: str = "") -> dict[str, Any]:
    """Values by path, of the table whose path is `above`.

    Raises:
        InputError: something else where a table belongs.
    """
    if not isinstance(content, dict):
        raise InputError(f"{above or 'settings'} must be a table, got {content!r}")
    values: dict[str, Any] = {}
    for name, value in content.items():
        path = f"{above}.{name}" if above else name
        path = SHORT.get(path, path) if isinstance(value, str) else path
        values |= _flattened(value, path) if path in TABLES else {path: value}
    return values


def changed(
    world: WorldConfig, task: str, sets: Sequence[str], base: TaskConfig | None = None
) -> tuple[WorldConfig, TaskConfig | None]:
    """A world and a task with what `--set` says of them; no task where none is named.

    Raises:
        InputError: no such task; a setting of something else, or an invalid one.
    """
    if not task:
        return world, None
    values = typed(sets, task)
    for path in values:
        if not path.startswith(("task.", "world.")) or path in FIXED:
            raise InputError(f"--set {path} is no setting of a test: give task.... or world....")
    config = replace(TrainConfig(), world=world, task=base or configured(TaskConfig(), task))
    config = laid_over(config, values)
    return config.world, config.task


def changed_world(world: WorldConfig, sets: Sequence[str]) -> WorldConfig:
    """A world with what `--set` says of it.

    Raises:
        InputError: a setting of something else, or an invalid one.
    """
    values = typed(sets)
    for path in values:
        if not path.startswith("world."):
            raise InputError(f"--set {path} is no setting of a world: give world....")
    return laid_over(replace(TrainConfig(), world=world), values).world


def combined(
    file: str, sets: Sequence[str], options: Mapping[str, tuple[str, Any]]
) -> dict[str, Any]:
    """What was asked for, by path: the file's settings, over them `--set` and the options.

    `options` has the value by path and the name of each option that was given.

    Raises:
        InputError: as `read_settings` and `typed`; two that contradict each other.
    """
    below = read_settings(file) if file else {}
    given = {path: value for path, (_, value) in options.items()}
    above = typed(sets, task_of({**below, **given}))
    for path, (name, value) in options.items():
        if above.get(path, value) != value:
            raise InputError(f"--set {path} and --{name} contradict each other: leave one out")
    above |= given
    _check_lengths_agree(above, options)
    if below.get("preset", above.get("preset")) != above.get("preset", below.get("preset")):
        raise InputError(
            f"{file} says preset {below['preset']}, {above['preset']} was given: leave the preset"
            " out, for all settings of the file stand above it"
        )
    return overlay(below, above)


def _check_lengths_agree(above: Mapping[str, Any], options: Mapping[str, tuple[str, Any]]) -> None:
    """Raise InputError if the one length and the several lengths contradict each other."""
    length, lengths = above.get("task.length"), above.get("mix.lengths")
    if length is None or not lengths or length == max(lengths):
        return

    def given(path: str, text: str) -> str:
        return f"--{options[path][0]} {text}" if path in options else f"--set {path}={text}"

    one = given("task.length", str(length))
    more = given("mix.lengths", lengths_as_text(lengths))
    raise InputError(f"{one} and {more} contradict each other: leave one out")


def check_agrees(asked: Mapping[str, Any], config: TrainConfig, run: Path) -> None:
    """Raise InputError unless the run has these settings, by path."""
    has = flat(config)
    for path, value in asked.items():
        check_path(path, config.task.name)
        if has[path] != value:
            raise InputError(
                f"--resume goes on with the settings of {run}, but {path} is {has[path]} in the"
                f" run, {value} was given: leave it out"
            )
