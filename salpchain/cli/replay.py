"""`salpchain replay`."""

from dataclasses import dataclass
from typing import Annotated

import tyro

from salpchain.cli.options import Flag, Lengths, Task, Whole, World, text_option
from salpchain.cli.outputs import check_new
from salpchain.cli.recordings import Limit, check_out, say_if_too_short, trajectories
from salpchain.cli.settings import Sets, changed_world
from salpchain.cli.video import sources_of
from salpchain.files import writing
from salpchain.world.presets import world_config


@dataclass(frozen=True)
class Replay:
    """Write swims as one HTML file to play, scrub and zoom in a browser; it needs no network.

    Takes policies, which swim first, or trajectories from salpchain rollout; several are shown
    side by side.

    Example: salpchain replay runs/eight --length 24 --out swim.html

    Example: salpchain replay runs/eight greedy --length 16 --out both.html
    """

    sources: tyro.conf.Positional[Annotated[tuple[str, ...], text_option("POLICY_OR_FILE")]] = ()
    """Run folders, policies, names that `salpchain models` lists, or trajectories (.npz).
    A name wins over a folder that is called so: write ./NAME for the folder."""
    out: Annotated[str, text_option("FILE.html")] = ""
    """The page to write."""
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
    overwrite: Flag = False
    """Replace the file if it exists."""


def run(options: Replay) -> None:
    """Swims where it must, writes the page, and says so."""
    sources = sources_of("", options.sources, "replay")
    out = check_out(options.out, (".html",), "replay")
    world = changed_world(world_config(options.world), options.set)
    asked = options.length, options.seed, options.trial, options.time_limit, world
    asked = *asked, options.task
    from salpchain.report.replay import write_replay

    with writing(out):
        if not options.overwrite:
            check_new(out)
        swims = trajectories(sources, *asked)
        write_replay(swims, out)
    say_if_too_short(swims)
    print(f"wrote {out} ({out.stat().st_size / 1e6:.2f} MB): open it in a browser")
