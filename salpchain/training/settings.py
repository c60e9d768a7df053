"""Settings of a training by their paths, such as `ppo.learning_rate`, laid over a preset.

The paths are those of a run's `config.json`. Imports nothing heavy: the command line reads it.
"""

import difflib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import is_dataclass, replace
from functools import cache
from operator import attrgetter
from typing import TYPE_CHECKING, Any, get_type_hints

from salpchain.checks import KINDS, check_length, check_seed, is_kind, one_of
from salpchain.errors import InputError
from salpchain.evaluation.config import Lengths, as_lengths, parse_lengths
from salpchain.given import instance, told
from salpchain.networks.config import SINGLE_LENGTH, ControlConfig
from salpchain.ranges import Range, as_range
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.registry import TASKS, config_class, configured, name_of
from salpchain.training.config import CUSTOM, TrainConfig
from salpchain.training.presets import PRESETS, many_lengths
from salpchain.world.config import WorldConfig
from salpchain.world.presets import as_config, world_config

if TYPE_CHECKING:
    from salpchain.tasks.task import Task

SHORT = {"world.dynamics": "world.dynamics.kind"}  # paths that stand for longer ones
ONE_LENGTH = {"mix.lengths": (), "mix.weights": (), "mix.grow": 0.0}
VARIANTS = ("model", "graph")  # of the controller, for which a preset may have values of its own
BOOLS = {"true": True, "false": False}


def _kinds(config: Any, before: str = "") -> dict[str, Any]:
    """The type of every setting of a dataclass by its path."""
    found: dict[str, Any] = {}
    for name, kind in get_type_hints(config).items():
        found |= _kinds(kind, f"{before}{name}.") if is_dataclass(kind) else {before + name: kind}
    return found


SETTINGS = _kinds(TrainConfig)  # of the task `reach`; others have some more
_PATHS = {*SETTINGS}  # of all tasks that were asked about


@cache
def settings_of(task: str) -> dict[str, Any]:
    """The type of every setting by its path, those of this task's own among them."""
    found = {**SETTINGS, **_kinds(config_class(task), "task.")}
    _PATHS.update(found)
    return found


def task_of(values: Mapping[str, Any]) -> str:
    """The name of the task that these settings, by path, are of."""
    name = values.get("task.name", TaskConfig.name)
    return instance("task.name", name, str, KINDS[str])


def flat(config: TrainConfig) -> dict[str, Any]:
    """The value of every setting by its path."""
    return {path: attrgetter(path)(config) for path in settings_of(config.task.name)}


def check_path(path: str, task: str = TaskConfig.name) -> None:
    """Raise InputError unless there is such a setting; the message names one that is near."""
    instance("a setting's path", path, str, "a text such as 'ppo.learning_rate'")
    known_paths = settings_of(task)
    if path in known_paths:
        return
    within = [known for known in known_paths if known.startswith(f"{path}.")]
    if within:
        raise InputError(f"{path} has several settings: {', '.join(within)}")
    others = [other for other in TASKS if other != task and path in settings_of(other)]
    if others:
        raise InputError(f"{path} is a setting of the task {' or '.join(others)}, not of {task}")
    near = _nearest(path, known_paths)
    said = f"perhaps {near}" if near else "docs/settings.md lists all that there are"
    raise InputError(f"unknown setting {path!r}: {said}")


def _nearest(path: str, paths: Iterable[str]) -> str:
    """The path whose last part is most like that of this one, in the same table if there is one, or
    the same in another; empty if none is."""
    table, _, name = path.lower().rpartition(".")
    last = {known.rpartition(".")[2]: known for known in paths}  # prefixes are not near
    top = f"{table.partition('.')[0]}." if table else ""
    within = {end: known for end, known in last.items() if known.startswith(top)} or last
    near = difflib.get_close_matches(name, within, n=1)
    return within[near[0]] if near else last.get(name, "")


@contextmanager
def part_of(part: str) -> Iterator[None]:
    """Lets errors about a field of this part of the settings name it by its path."""
    try:
        yield
    except InputError as error:
        name = str(error).partition(" ")[0]
        if f"{part}.{name}" not in _PATHS:
            raise
        told = InputError(f"{part}.{error}")
        told.typed = f"{part}.{error.typed}"
        raise told from None


def checked(path: str, value: Any, task: str = TaskConfig.name) -> Any:
    """The value as the setting holds it: lists as tuples, whole numbers as such or as decimals.

    Raises:
        InputError: no such setting, or a value of another type.
    """
    check_path(path, task)
    kind = settings_of(task)[path]
    if kind is Range:
        return _range(path, value)
    value = tuple(value) if isinstance(value, list) else value
    if getattr(value, "shape", None) == ():  # a number of NumPy's or JAX's
        value = value.item()
    if not is_kind(value, kind):
        raise InputError(f"{path} must be {KINDS[kind]}, got {told(value)}")
    return float(value) if kind is float else value


def _range(path: str, value: Any) -> Range:
    try:
        return as_range(value)
    except InputError as error:
        raise InputError(f"{path} {error}") from None


def parsed(path: str, text: str, task: str = TaskConfig.name) -> Any:
    """The value of a setting that was typed: `true`, `1e-3`, `4,8,16` or `4..16`.

    Raises:
        InputError: no such setting, or the text is no such value.
    """
    check_path(path, task)
    kind = settings_of(task)[path]
    if kind is Range:
        return _range(path, text)
    try:
        return checked(path, _value(kind, text), task)
    except (ValueError, OverflowError, KeyError):
        raise InputError(f"{path} must be {KINDS[kind]}, got {text!r}") from None


def _value(kind: Any, text: str) -> Any:
    if kind is bool:
        return BOOLS[text.lower()]
    if kind is int:
        return _whole(text)
    if kind is float:
        return float(text)
    if kind is str:
        return text
    text = text.strip().removeprefix("[").removesuffix("]")  # as config.json writes lists
    if kind == tuple[int, ...]:
        return tuple(parse_lengths(text)) if text else ()
    return tuple(float(part) for part in text.split(",")) if text else ()


def _whole(text: str) -> int:
    """A whole number, which may be typed as 30_000 or 3e4."""
    try:
        return int(text)
    except ValueError:
        value = float(text)
        if not value.is_integer():
            raise
        return int(value)


def typed(sets: Sequence[str], task: str | None = None) -> dict[str, Any]:
    """The values of `--set PATH=VALUE`, by path; `task` names the task unless they do.

    Raises:
        InputError: another form, an unknown setting, a value of another type, or a setting given
            twice.
    """
    values: dict[str, Any] = {}
    named = [text.partition("=")[2] for text in sets if text.startswith("task.name=")]
    task = (named or [task or TaskConfig.name])[0]
    for text in sets:
        path, equals, value = text.partition("=")
        path = SHORT.get(path, path)
        if not equals:
            raise InputError(f"--set must be like ppo.learning_rate=1e-3, got {text!r}")
        if path in values:
            raise InputError(f"--set {path} is given twice: leave one out")
        values[path] = parsed(path, value, task)
    return values


def overlay(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """Settings where those above win.

    The lengths go together, and so does a world: new ones replace all of the old.
    """
    if above.get("world.name", below.get("world.name")) != below.get("world.name"):
        below = {path: value for path, value in below.items() if not path.startswith("world.")}
    lengths = above.get("mix.lengths")
    if lengths:
        above = {"task.length": max(lengths), **above}
    if lengths is None and "task.length" in above and below.get("mix.lengths"):
        above = {**ONE_LENGTH, **above}
    if lengths is not None and len(lengths) < 2:
        above = {**ONE_LENGTH, **above}
    return {**below, **above}


def compose(values: Mapping[str, Any]) -> TrainConfig:
    """A preset with these settings in place of its own; `preset` among them names it.

    What a preset depends on (model, graph, lengths) is taken into account before the rest is laid
    over it.

    Raises:
        InputError: an unknown setting or preset, or invalid values.
    """
    task = task_of(values)
    values = overlay({}, {path: checked(path, value, task) for path, value in values.items()})
    return laid_over(_base(values), values)


def _base(values: Mapping[str, Any]) -> TrainConfig:
    """The preset as it is for the model, graph and lengths among the values."""
    name = values.get("preset", "quick")
    one_of("preset", name, (*PRESETS, CUSTOM))
    given = {part: values[f"control.{part}"] for part in VARIANTS if f"control.{part}" in values}
    with part_of("control"):
        control = ControlConfig(**given)
    with part_of("task"):
        length = check_length(values.get("task.length", TaskConfig.length))
    if name == CUSTOM:
        return TrainConfig(task=TaskConfig(length=length), control=control, preset=CUSTOM)
    base = PRESETS[name](length, control)
    many = name == "quick" and len(values.get("mix.lengths", ())) > 1
    return many_lengths(base) if many else base


def laid_over(config: TrainConfig, values: Mapping[str, Any]) -> TrainConfig:
    """The config with these settings in place of its own, checked all together.

    Raises:
        InputError: invalid values.
    """
    if "world.name" in values:
        config = replace(config, world=world_config(values["world.name"]))
    if values.get("task.name", config.task.name) != config.task.name:
        config = replace(config, task=configured(config.task, values["task.name"]))
    return _replaced(config, values)


def elsewhere(
    config: TrainConfig,
    task: "str | type[Task] | TaskConfig | None",
    world: WorldConfig | str | None,
) -> TrainConfig:
    """The same training of another task or in another world, where one is given.

    A task that is given by its name or class keeps what the settings and it have in common: length,
    observation, action, time limit.

    Raises:
        InputError: no settings, or no such task or world.
    """
    instance("config", config, TrainConfig, 'a TrainConfig, such as salpchain.preset("quick")')
    if isinstance(task, TaskConfig):
        config = replace(config, task=task)
    elif task is not None:
        config = replace(config, task=configured(config.task, name_of(task)))
    return config if world is None else replace(config, world=as_config(world))


def _replaced(config: Any, values: Mapping[str, Any], above: str = "") -> Any:
    """A dataclass with these settings, by their paths in it; `above` is its own path."""
    parts: dict[str, dict[str, Any]] = {}
    for path, value in values.items():
        part, _, inner = path.partition(".")
        parts.setdefault(part, {})[inner] = value
    built = {
        part: given[""] if "" in given else _replaced(getattr(config, part), given, part)
        for part, given in parts.items()
    }
    with part_of(above):
        return replace(config, **built)


def changed(config: TrainConfig) -> list[str]:
    """The paths of all settings that are otherwise than in the config's preset.

    What one chooses a variant of a preset by is not among them: model, graph, lengths, seed, name.
    None of a config without a preset.
    """
    if config.preset not in PRESETS:
        return []
    values = flat(config)
    base = flat(laid_over(_base(values), {"task.name": config.task.name}))
    chosen = {"control.model", "control.graph", "task.length", "task.name", "seed", "name"}
    chosen |= ONE_LENGTH.keys()
    return [path for path in values if path not in chosen and values[path] != base[path]]


def preset(
    name: str = "quick",
    *,
    length: Lengths = TaskConfig.length,
    model: str | None = None,
    graph: str | None = None,
    seed: int = 0,
    world: WorldConfig | str | None = None,
    task: "str | type[Task] | None" = None,
    settings: Mapping[str, object] | None = None,
    **others: object,
) -> TrainConfig:
    """A preset for a chain length (units), or for several at once, with single settings changed.

    `settings` has any of `config.json` by their paths: `{"ppo.learning_rate": 1e-3}`. Several
    lengths may also be a text such as `4..16`. `task` is the name of one, or its class, `world` the
    name of one, or its settings.

    Raises:
        InputError: no such preset or setting, or an invalid value; the message says what is valid.
    """
    for other, value in others.items():
        check_path(other)
        raise InputError(f"{other} is a setting: give settings={{{other!r}: {told(value)}}}")
    one_of("preset", name, (*PRESETS, CUSTOM))
    check_seed(seed)
    settings = {} if settings is None else settings
    instance("settings", settings, Mapping, "a dict such as {'ppo.learning_rate': 1e-3}")
    units = as_lengths(length)
    lengths = {"task.length": units[0]} if len(units) == 1 else {"mix.lengths": tuple(units)}
    asked = {"preset": name, "control.model": model, "control.graph": graph, "seed": seed}
    asked["task.name"] = None if task is None else name_of(task)
    values = {path: value for path, value in asked.items() if value is not None}
    settings = {SHORT.get(path, path): value for path, value in settings.items()}
    kind = task_of({**values, **settings})
    above = {path: checked(path, value, kind) for path, value in settings.items()}
    config = elsewhere(compose(overlay({**values, **lengths}, above)), None, world)
    if graph is not None and model in SINGLE_LENGTH:
        raise InputError(f"an {model} has no graph, got {graph}: leave the graph out")
    return laid_over(config, above)
