"""`salpchain video`."""

from dataclasses import dataclass
from typing import Annotated

import tyro

from salpchain.cli.options import Flag, Lengths, Task, Whole, World, text_option
from salpchain.cli.outputs import check_new
from salpchain.cli.recordings import (
    Decimal,
    Limit,
    check_out,
    decimal,
    say_if_too_short,
    trajectories,
)
from salpchain.cli.settings import Sets, changed_world
from salpchain.errors import InputError
from salpchain.files import writing
from salpchain.world.presets import world_config

SUFFIXES = (".mp4", ".gif", ".png")
GRID = "4,8,16,32,64"


@dataclass(frozen=True)
class Video:
    """Draw a swim as a video (.mp4, .gif) or as a strip of moments (.png).

    Takes policies, which swim first, or trajectories from salpchain rollout. An .mp4 needs
    the extra `video`; where it is missing, the error names the command that installs it.

    Example: salpchain video runs/eight --length 24 --out swim.mp4

    Example: salpchain video --compare runs/eight greedy --length 16 --out both.gif

    Example: salpchain video runs/eight --grid --out lengths.mp4
    """

    source: tyro.conf.Positional[Annotated[str, text_option("POLICY_OR_TRAJECTORY")]] = ""
    """Run folders, policies, names that `salpchain models` lists, or trajectories (.npz).
    A name wins over a folder that is called so: write ./NAME for the folder."""
    out: Annotated[str, text_option("FILE.mp4|gif|png")] = ""
    """The file to write; its suffix chooses the form."""
    length: Lengths = "8"
    """Units of the chain; several lengths swim side by side."""
    seed: Whole = "0"
    """Seed of the starts."""
    trial: Whole = "0"
    """Number of the start among those of the seed."""
    time_limit: Limit = "scaled"
    """scaled (32 steps for each unit, at least 512) or fixed (512 steps, the paper's)."""
    task: Task = ""
    """What it is to do: reach (the paper's: take a target pose), follow (a target that moves),
    dock, passage or gather (docs/tasks.md), or one of your own, module:Class. Default: what the
    policy was trained for."""
    world: World = "still"
    set: Sets = ()
    """Any number of the world, such as world.dynamics=landsalp or world.current.speed=0:0.08; may
    be given several times. docs/settings.md lists them."""
    compare: Annotated[tuple[str, ...], text_option("A B")] = ()
    """Two or more policies or trajectories, side by side on the same episode."""
    grid: Flag = False
    """Lengths 4, 8, 16, 32 and 64 at once."""
    size: Annotated[str, text_option("WIDTHxHEIGHT")] = ""
    """In pixels. Default: 1280x720; 640x360 for a .gif; 320x220 for each moment of a strip."""
    speed: Decimal = ""
    """Seconds of swimming in each second of video. Default: 2; 4 for a .gif; of chains with
    other dynamics as many control steps."""
    rate: Decimal = ""
    """Frames in each second of video. Default: 30; 15 for a .gif."""
    overwrite: Flag = False
    """Replace the file if it exists."""


def run(options: Video) -> None:
    """Swims where it must, draws, and says what was written."""
    sources = sources_of(options.source, options.compare, "video")
    out = check_out(options.out, SUFFIXES, "video")
    width, height = _size(options.size)
    world = changed_world(world_config(options.world), options.set)
    from salpchain.report.video import paced, with_defaults, write_video

    speed, rate = decimal("speed", options.speed), decimal("rate", options.rate)
    film = with_defaults(out, width=width, height=height, speed=speed, rate=rate)
    lengths = GRID if options.grid else options.length
    from salpchain.cli.display import share_display

    with writing(out):
        if not options.overwrite:
            check_new(out)
        asked = options.seed, options.trial, options.time_limit, world, options.task
        swims = trajectories(sources, lengths, *asked)
        if options.compare:
            _check_same_episode(swims)
        film = film if options.speed else paced(film, swims)
        with share_display("drawing") as watch:
            write_video(swims, out, film, progress=lambda share: watch(share, out.name))
    say_if_too_short(swims)
    print(f"wrote {out}")


def sources_of(source: str, more: tuple[str, ...], command: str) -> list[str]:
    """All sources that a command was given.

    Raises:
        InputError: none.
    """
    sources = [name for name in (source, *more) if name]
    if not sources:
        raise InputError(
            f"salpchain {command} needs a run folder, a policy or a trajectory, e.g. runs/eight"
        )
    return sources


def _size(text: str) -> tuple[int | None, int | None]:
    if not text:
        return None, None
    parts = text.lower().split("x")
    if len(parts) != 2 or not all(part.isdigit() for part in parts):
        raise InputError(f"--size must be like 1280x720, got {text!r}")
    return int(parts[0]), int(parts[1])


def _check_same_episode(swims: list) -> None:
    starts = {(swim.length, tuple(swim.targets[0].ravel().round(4).tolist())) for swim in swims}
    lengths = {swim.length for swim in swims}
    if len(starts) > len(lengths) or any(
        sum(swim.length == length for swim in swims) * len(lengths) != len(swims)
        for length in lengths
    ):
        raise InputError("--compare needs swims of the same episode, got different targets")
