"""Says where the water may flow faster than a chain can swim, in one line for the user."""

from collections.abc import Sequence

from salpchain.evaluation.limits import cruising_speed
from salpchain.physics.state import Physics
from salpchain.world.config import WorldConfig


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
