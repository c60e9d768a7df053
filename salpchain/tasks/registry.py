"""Tasks by name: those of the package, and a user's own as `module:Class`.

Imports nothing heavy until a task itself is asked for.
"""

from dataclasses import MISSING, fields
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple, get_type_hints

from salpchain.checks import KINDS
from salpchain.errors import InputError
from salpchain.given import instance, told
from salpchain.plugins import check_known, find, path_of

if TYPE_CHECKING:
    from salpchain.tasks.config import TaskConfig
    from salpchain.tasks.task import Task
    from salpchain.world.randomise import WorldLike


class Spec(NamedTuple):
    """A task of the package: where its settings are, and where it is itself."""

    config: str
    task: str


TASKS: dict[str, Spec] = {
    "reach": Spec("salpchain.tasks.config:TaskConfig", "salpchain.tasks.reach.task:SCLD"),
    "follow": Spec(
        "salpchain.tasks.follow.config:FollowConfig", "salpchain.tasks.follow.task:Follow"
    ),
    **{
        name: Spec(
            f"salpchain.tasks.parting.config:{kind}Config", f"salpchain.tasks.parting.{name}:{kind}"
        )
        for name, kind in (("dock", "Dock"), ("passage", "Passage"), ("gather", "Gather"))
    },
}


def check_task(name: object) -> None:
    """Raise InputError unless this may name a task; whether its module is there shows later."""
    check_known("task", name, TASKS)


def task_class(name: str) -> "type[Task]":
    """The class of a task.

    Raises:
        InputError: there is none of this name, or what there is is no task.
    """
    check_task(name)
    from salpchain.tasks.task import Task

    found: Any = _at(TASKS[name].task) if name in TASKS else find("task", name)
    if not (isinstance(found, type) and issubclass(found, Task)):
        raise InputError(f"task {name} must be a class that is a salpchain.Task, got {told(found)}")
    return found


def config_class(name: str) -> "type[TaskConfig]":
    """The class of a task's settings: that of the default of its field `config`.

    Raises:
        InputError: as `task_class`, or a setting that no file and no command line could hold.
    """
    check_task(name)
    if name in TASKS:
        return _at(TASKS[name].config)
    from salpchain.tasks.config import TaskConfig

    declared = {field.name: field for field in fields(task_class(name))}["config"]
    kind: Any = declared.default_factory
    if kind is MISSING:
        kind = type(declared.default)
    if not (isinstance(kind, type) and issubclass(kind, TaskConfig)):
        raise InputError(f"task {name} must have a TaskConfig as config, got {told(kind)}")
    for setting, of in get_type_hints(kind).items():
        if of not in KINDS:
            right = ", ".join(dict.fromkeys(KINDS.values()))
            raise InputError(f"setting {setting} of task {name} must be {right}, got {told(of)}")
    return kind


def configured(config: "TaskConfig", name: str) -> "TaskConfig":
    """The same settings, as far as both have them, of the task of this name."""
    kind = config_class(name)
    shared = {field.name for field in fields(kind)} & {field.name for field in fields(config)}
    kept = {field: getattr(config, field) for field in shared}
    return kind(**{**kept, "name": name})


def make_task(config: "TaskConfig", world: "WorldLike" = None) -> "Task":
    """The task that these settings name, in a world (see `Task`).

    Raises:
        InputError: no settings, no such task, another kind of world, or a task of one's own whose
            methods do not give what they should.
    """
    from salpchain.tasks.config import TaskConfig

    instance("config", config, TaskConfig, "a TaskConfig, such as card.task(length)")
    task = task_class(config.name)(config, world)
    if config.name not in TASKS:
        _check_once(type(task), config)
    return task


@cache
def _check_once(kind: "type[Task]", config: "TaskConfig") -> None:
    """Raise InputError unless a task of a user's own keeps its contract; in still water."""
    from salpchain.tasks.contract import check_contract

    check_contract(kind(config))


def name_of(task: "str | type[Task]") -> str:
    """The name of the task that is meant, by which it is found again.

    Raises:
        InputError: neither a name nor a class of one, or there is none.
    """
    if isinstance(task, type):
        known = {spec.task: name for name, spec in TASKS.items()}
        task = known.get(path_of(task), path_of(task))
    if not isinstance(task, str):
        raise InputError(f"task must be the name or the class of one, got {told(task)}")
    task_class(task)
    return task


def as_config(task: "str | type[Task] | TaskConfig") -> "TaskConfig":
    """The settings of the task that is meant: by its name, its class, or its settings.

    Raises:
        InputError: none is meant, or there is none.
    """
    from salpchain.tasks.config import TaskConfig

    if isinstance(task, TaskConfig):
        return task
    return configured(TaskConfig(), name_of(task))


def own_settings(config: "TaskConfig") -> dict[str, Any]:
    """The settings that are of this task alone."""
    from salpchain.tasks.config import TaskConfig

    shared = {field.name for field in fields(TaskConfig)}
    own = [field.name for field in fields(config) if field.name not in shared]
    return {name: getattr(config, name) for name in own}


def as_tested(config: "TaskConfig") -> "TaskConfig":
    """The task with its own settings, and all that tasks share as they are where one is tested."""
    return config_class(config.name)(name=config.name, **own_settings(config))


def label(config: "TaskConfig") -> str:
    """The name of the task, and what is otherwise than usual in its own settings."""
    usual = own_settings(config_class(config.name)())
    changes = [
        f"{name} {value:g}" if isinstance(value, float) else f"{name} {value}"
        for name, value in own_settings(config).items()
        if value != usual[name]
    ]
    return f"{config.name} with {', '.join(changes)}" if changes else config.name


def _at(path: str) -> Any:
    module, _, name = path.partition(":")
    return getattr(import_module(module), name)
