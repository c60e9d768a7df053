"""What the commands that show swims read: policies to be recorded, or recorded trajectories."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from salpchain.checks import check_seed, one_of
from salpchain.cli.options import number, text_option
from salpchain.cli.streams import say
from salpchain.controllers.named import check_there, load
from salpchain.errors import InputError
from salpchain.evaluation.config import parse_lengths
from salpchain.report.labels import labels
from salpchain.tasks.config import TIME_LIMITS
from salpchain.tasks.registry import as_config as task_config
from salpchain.world.config import DynamicsConfig, WorldConfig
from salpchain.world.presets import label

if TYPE_CHECKING:
    from salpchain.controllers.policy import Controller
    from salpchain.evaluation.trajectory import Trajectory

Limit = Annotated[str, text_option("scaled|fixed")]
Decimal = Annotated[str, text_option("NUMBER")]


def trajectories(
    sources: Sequence[str],
    lengths: str,
    seed: str,
    trial: str,
    time_limit: str,
    world: WorldConfig,
    task: str,
) -> list["Trajectory"]:
    """For each source its swims: a recorded one (`.npz`), or one trial of each length.

    All that is asked for is checked before any work starts.

    Raises:
        InputError: no such policy or trajectory, or an invalid length, seed, trial or limit.
    """
    wanted = parse_lengths(lengths)
    start = check_seed(number("seed", seed))
    which = number("trial", trial)
    if which < 0:
        raise InputError(f"--trial must be 0 or more, got {which}")
    one_of("time limit", time_limit, TIME_LIMITS)
    kind = task_config(task) if task else None
    files, controllers = _read(sources, wanted)
    swims: list[tuple[str, Trajectory]] = []
    for source in sources:
        if source in files:
            swims.append((source, files[source]))
            continue
        from salpchain.cli.display import share_display
        from salpchain.evaluation.recording import record

        with share_display("recording") as watch:
            asked = controllers[source], wanted, time_limit, start, which
            made = record(*asked, progress=watch, world=world, task=kind)
        say_if_trained_elsewhere(controllers[source], world)
        swims += [(source, swim) for swim in made]
    return _told_apart(swims)


def _read(
    sources: Sequence[str], lengths: Sequence[int]
) -> tuple[dict[str, "Trajectory"], dict[str, "Controller"]]:
    """The recorded swims and the controllers among the sources; these serve all lengths."""
    for source in sources:
        if not source.endswith(".npz"):
            check_there(source)
    from salpchain.devices import use_devices
    from salpchain.evaluation.trajectory import Trajectory

    use_devices()  # before JAX starts, which reading a policy does
    files = {s: Trajectory.load(Path(s)) for s in sources if s.endswith(".npz")}
    controllers = {s: load(s) for s in sources if s not in files}
    for swimmer in controllers.values():
        for length in lengths:
            swimmer.card.check_serves(length)
    return files, controllers


def _told_apart(swims: Sequence[tuple[str, "Trajectory"]]) -> list["Trajectory"]:
    """The swims; where policies of one name come from several sources, by the shortest paths."""
    named = list(dict.fromkeys((source, swim.policy) for source, swim in swims))
    told = labels([name for _, name in named], [Path(source) for source, _ in named])
    called = dict(zip(named, told, strict=True))
    return [replace(swim, policy=called[source, swim.policy]) for source, swim in swims]


def say_if_trained_elsewhere(controller: "Controller", world: WorldConfig) -> None:
    """Prints a line where a policy was trained in another world than the paper's and this, or for
    the paper's chains and this has others."""
    card, here = controller.card, label(world)
    others = world.dynamics.kind != DynamicsConfig.kind
    if card.steps and card.world != here and (card.world != "still" or others):
        say(f"{card.name} was trained in {card.world}, here in {here}: {_REMEDY}")


_REMEDY = "--world and --set world.... say where it swims"


def say_if_too_short(swims: Sequence["Trajectory"]) -> None:
    """Prints a line where no controller could have come to the targets within the time limit."""
    from salpchain.evaluation import impossible

    say(impossible.of_swims(swims))


def check_out(out: str, suffixes: Sequence[str], command: str) -> Path:
    """The path of a file to be written.

    Raises:
        InputError: none was given, it has another suffix, or its folder is missing.
    """
    if not out:
        raise InputError(f"salpchain {command} needs --out, a file that ends in {suffixes[0]}")
    path = Path(out)
    if path.suffix.lower() not in suffixes:
        raise InputError(f"--out must end in {' or '.join(suffixes)}, got {out}")
    if not path.parent.is_dir():
        raise InputError(f"no such folder for --out: {path.parent}")
    if path.is_dir():
        raise InputError(f"--out is a folder, not a file: {path}")
    return path


def decimal(name: str, text: str) -> float | None:
    """The number that an option holds; None where it was left out.

    Raises:
        InputError: it is something else.
    """
    if not text:
        return None
    try:
        return float(text)
    except ValueError:
        raise InputError(f"--{name} must be a number, got {text!r}") from None
