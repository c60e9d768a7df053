"""`salpchain rollout`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from salpchain.checks import check_length
from salpchain.cli.options import Flag, Task, Whole, World, number, text_option
from salpchain.cli.outputs import check_new
from salpchain.cli.recordings import Limit, check_out, say_if_too_short, trajectories
from salpchain.cli.settings import Sets, changed_world
from salpchain.controllers.named import load
from salpchain.errors import InputError
from salpchain.files import writing
from salpchain.tasks.registry import as_config
from salpchain.tasks.registry import label as task_label
from salpchain.world.presets import label, world_config


@dataclass(frozen=True)
class Rollout:
    """Record one episode: every body, thrust and reward at every control step, as one .npz.

    The start is that of the same trial in salpchain evaluate. `salpchain.Trajectory.load` reads the
    file, and salpchain video and salpchain replay show it; `numpy.load` reads it too.

    Example: salpchain rollout runs/eight --length 24 --seed 3 --out swim.npz
    """

    policy: tyro.conf.Positional[Annotated[str, text_option("RUN_OR_POLICY")]] = ""
    """A run folder, a policy.safetensors, or a name that `salpchain models` lists.
    A name wins over a folder that is called so: write ./NAME for the folder."""
    length: Whole = "8"
    """Units of the chain."""
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
    out: Annotated[str, text_option("FILE.npz")] = ""
    """The file to write. One that holds another episode is kept, and this one refused."""
    overwrite: Flag = False
    """Replace the file whatever it holds."""


def run(options: Rollout) -> None:
    """Records, saves, and says how it ended."""
    if not options.policy:
        raise InputError("salpchain rollout needs a run folder or a policy, e.g. runs/eight")
    out = check_out(options.out, (".npz",), "rollout")
    if options.policy.endswith(".npz"):
        raise InputError(f"{options.policy} is recorded already: give a policy")
    length = str(check_length(number("length", options.length)))
    world = changed_world(world_config(options.world), options.set)
    asked = length, options.seed, options.trial, options.time_limit, world
    with writing(out):
        if out.exists() and not options.overwrite:
            _check_same(out, options, label(world))
        (swim,) = trajectories([options.policy], *asked, options.task)
        swim.save(out)
    end = "goal reached" if swim.success else "goal not reached"
    closed = f"{100 * swim.closed_fraction:.1f} % closed"
    if swim.target_moves:
        end, closed = "swam", f"{100 * swim.distance.mean():.1f} cm from its target on average"
    about = ", ".join([swim.policy, f"{swim.length} units", *swim.unusual])
    print(f"{about}: {end} after {swim.duration:.1f} s, {closed}")
    say_if_too_short([swim])
    print(f"wrote {out}")


def _check_same(out: Path, options: Rollout, world: str) -> None:
    """Raise InputError unless the file holds the episode that is asked for."""
    from salpchain.controllers.identity import identity
    from salpchain.evaluation.trajectory import Trajectory

    try:
        kept = Trajectory.load(out)
        about = kept.time_limit, kept.world, kept.task
        has = kept.identity, kept.length, kept.seed, kept.trial, *about
    except InputError:
        has = ()
    numbers = [number(name, getattr(options, name)) for name in ("length", "seed", "trial")]
    policy = load(options.policy)
    task = as_config(options.task) if options.task else policy.card.trained_for
    asked = *numbers, options.time_limit, world, task_label(task)
    if has != (identity(policy), *asked):
        check_new(out)
