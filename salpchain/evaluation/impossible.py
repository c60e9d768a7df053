"""Says in one line where no controller can do what is asked: too short a time, too fast a water."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from salpchain.evaluation.limits import centroid_slack, cruising_speed, distance_covered
from salpchain.evaluation.trajectory import Trajectory
from salpchain.physics.state import Physics
from salpchain.tasks.config import STEPS_PER_UNIT, step_limit
from salpchain.world.config import WorldConfig

SHOWN = 0.9995  # a closed fraction of at least this is shown as 100.0 %


def of_summary(summary: Mapping[str, Any]) -> str:
    """The line about an evaluation, by the mean physical limit of each length; empty if none."""
    rows = summary["lengths"]
    most = {row["length"]: row["reachable"]["mean"] for row in rows}
    if None in most.values():  # nobody knows, where the target moves
        return ""
    return _line(summary["time_limit"], most, "on average")


def of_swims(swims: Sequence[Trajectory]) -> str:
    """The line about swims that missed their target, by the physical limit of each; empty if none.

    Of several swims of one length the least limit counts.
    """
    for limit in dict.fromkeys(swim.time_limit for swim in swims):
        missed = [swim for swim in swims if swim.time_limit == limit and not swim.success]
        most: dict[int, float] = {}
        for swim in sorted(missed, key=lambda swim: swim.length):
            most[swim.length] = min(reachable_in(swim), most.get(swim.length, 1.0))
        line = _line(limit, most, "of the way to this target")
        if line:
            return line
    return ""


def of_water(world: WorldConfig, lengths: Sequence[int]) -> str:
    """The line about a world in which chains of these lengths are to hold a target; empty if they
    can.

    A vortex counts with its greatest speed, water that wanders with three of its deviations.
    """
    current = world.current
    flow = current.speed.high + current.vortex.high + 3 * current.wander.high
    speeds = {length: float(cruising_speed(Physics(), length)) for length in lengths}
    slowest = min(speeds, key=speeds.__getitem__)
    if flow <= speeds[slowest]:
        return ""
    return (
        f"note: the water of this world may flow at {flow:.2f} m/s, {slowest} units swim at"
        f" {speeds[slowest]:.2f} m/s at most: against it no controller can reach a target"
    )


def reachable_in(swim: Trajectory, physics: Physics | None = None) -> float:
    """The largest closed fraction that any controller can have from the start of this swim.

    As `limits.reachable` at its time limit, of a chain that starts at rest; 1 where its target
    moves, and of chains of rigid links.
    """
    if swim.target_moves or swim.is_rigid:  # nobody knows
        return 1.0
    physics = physics or Physics()
    length, steps = swim.length, step_limit(swim.time_limit, swim.length)
    bodies = (swim.unit_position[0], physics.unit_mass), (swim.link_position[0], physics.link_mass)
    mass = sum(len(places) * each for places, each in bodies)
    middle = sum(places.sum(axis=0) * each for places, each in bodies) / mass
    apart = float(np.linalg.norm(swim.target.mean(axis=0) - middle))
    reach = float(distance_covered(physics, length, steps) + centroid_slack(physics, length))
    return 1.0 - max(apart - reach, 0.0) / max(float(swim.distance[0]), 1e-9)


def _line(time_limit: str, most: Mapping[int, float], what: str) -> str:
    """`most`: by length, ascending, the closed fraction that physics allows."""
    short = {length: share for length, share in most.items() if share < SHOWN}
    if time_limit != "fixed" or not short:
        return ""
    low, high = (f"{100 * pick(short.values()):.1f}" for pick in (min, max))
    closed = f"{low} %" if low == high else f"{low} to {high} %"
    return (
        f"{step_limit(time_limit, 2)} steps are too short at {_units(list(most), list(short))}:"
        f" no controller can close more than {closed} {what}"
        f" (--time-limit scaled gives {STEPS_PER_UNIT} steps for each unit)"
    )


def _units(played: list[int], short: list[int]) -> str:
    """The lengths as text: a range where they follow each other among those that were played."""
    first = played.index(short[0])
    if len(short) > 2 and played[first : first + len(short)] == short:
        return f"{short[0]} to {short[-1]} units"
    return f"{', '.join(map(str, short))} units"
