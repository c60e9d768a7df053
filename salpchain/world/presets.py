"""Named worlds: what `--world NAME` means."""

from dataclasses import replace

from salpchain.errors import InputError
from salpchain.given import told
from salpchain.world.config import (
    CurrentConfig,
    DynamicsConfig,
    Range,
    SensingConfig,
    ThrusterConfig,
    WorldConfig,
)

WORLDS: dict[str, tuple[str, WorldConfig]] = {
    "still": ("the paper's: still water, perfect sensors", WorldConfig()),
    "current": (
        "uniform currents up to 8 cm/s that change in time",
        WorldConfig(current=CurrentConfig(speed=Range(0.0, 0.06), wander=Range(0.0, 0.02))),
    ),
    "vortex": (
        "a vortex of 2 to 8 cm/s near the way",
        WorldConfig(current=CurrentConfig(vortex=Range(0.02, 0.08))),
    ),
    "failing": (
        "up to half of the thrusters dead from the start, up to a quarter fail on the way",
        WorldConfig(thrusters=ThrusterConfig(dead=Range(0.0, 0.5), failing=Range(0.0, 0.25))),
    ),
    "noisy": (
        "noisy, late, stuck and dropped readings",
        WorldConfig(
            sensing=SensingConfig(
                position=Range(0.0, 0.01),
                angle=Range(0.0, 0.1),
                dropped=Range(0.0, 0.05),
                stuck=Range(0.0, 0.05),
                delay=Range(0.0, 2.0),
            )
        ),
    ),
    "rough": (
        "all at once, in moderation: currents, dead and weak thrusters, noise, delay, physics",
        WorldConfig(
            dynamics=DynamicsConfig(
                mass=Range(0.8, 1.2), drag=Range(0.8, 1.2), stiffness=Range(0.8, 1.2)
            ),
            current=CurrentConfig(speed=Range(0.0, 0.04), wander=Range(0.0, 0.01)),
            thrusters=ThrusterConfig(dead=Range(0.0, 0.25), gain=Range(0.8, 1.0)),
            sensing=SensingConfig(
                position=Range(0.0, 0.005),
                angle=Range(0.0, 0.05),
                dropped=Range(0.0, 0.01),
                delay=Range(0.0, 1.0),
                action_delay=Range(0.0, 1.0),
            ),
        ),
    ),
}


def as_config(world: WorldConfig | str) -> WorldConfig:
    """The settings of a world, or of the one of this name.

    Raises:
        InputError: neither.
    """
    if isinstance(world, WorldConfig):
        return world
    if not isinstance(world, str):
        raise InputError(f"world must be a WorldConfig or a name of one, got {told(world)}")
    return world_config(world)


def world_config(name: str) -> WorldConfig:
    """The world of this name.

    Raises:
        InputError: there is none; the message lists the names.
    """
    if name not in WORLDS:
        raise InputError(f"unknown world {name!r}: choose one of {', '.join(WORLDS)}")
    return replace(WORLDS[name][1], name=name)
