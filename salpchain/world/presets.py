"""Named worlds: what `--world NAME` means; docs/world.md describes each."""

from dataclasses import replace

from salpchain.errors import InputError
from salpchain.given import told
from salpchain.ranges import Range
from salpchain.world.config import (
    CurrentConfig,
    DynamicsConfig,
    ObstacleConfig,
    SensingConfig,
    ThrusterConfig,
    WorldConfig,
)

WORLDS: dict[str, WorldConfig] = {
    "still": WorldConfig(),
    "current": WorldConfig(current=CurrentConfig(speed=Range(0.0, 0.06), wander=Range(0.0, 0.02))),
    "vortex": WorldConfig(current=CurrentConfig(vortex=Range(0.02, 0.08))),
    "failing": WorldConfig(
        thrusters=ThrusterConfig(dead=Range(0.0, 0.5), failing=Range(0.0, 0.25))
    ),
    "noisy": WorldConfig(
        sensing=SensingConfig(
            position=Range(0.0, 0.01),
            angle=Range(0.0, 0.1),
            dropped=Range(0.0, 0.05),
            stuck=Range(0.0, 0.05),
            delay=Range(0.0, 2.0),
        )
    ),
    "posts": WorldConfig(obstacles=ObstacleConfig(posts=Range(3.0, 8.0))),
    "room": WorldConfig(
        obstacles=ObstacleConfig(room=Range(0.3, 0.8), walls=Range(0.0, 2.0), posts=Range(0.0, 2.0))
    ),
    "sea": WorldConfig(
        dynamics=DynamicsConfig(
            mass=Range(0.6, 1.4), drag=Range(0.6, 1.4), stiffness=Range(0.6, 1.4)
        ),
        current=CurrentConfig(
            speed=Range(0.0, 0.08),
            shear=Range(0.0, 0.1),
            vortex=Range(0.0, 0.03),
            wander=Range(0.0, 0.02),
        ),
        thrusters=ThrusterConfig(
            dead=Range(0.0, 0.5),
            failing=Range(0.0, 0.5),
            gain=Range(0.4, 1.0),
            lag=Range(0.0, 0.4),
            one_sided=True,
        ),
        sensing=SensingConfig(
            position=Range(0.0, 0.01),
            angle=Range(0.0, 0.1),
            dropped=Range(0.0, 0.1),
            dropped_steps=Range(1.0, 10.0),
            stuck=Range(0.0, 0.1),
            stuck_steps=Range(1.0, 10.0),
            delay=Range(0.0, 3.0),
            action_delay=Range(0.0, 3.0),
            repeat=Range(1.0, 3.0),
        ),
        spared=Range(0.0, 1.0),
    ),
    "rough": WorldConfig(
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
    return replace(WORLDS[name], name=name)


def label(world: WorldConfig) -> str:
    """The name of the preset, and what is otherwise than in it."""
    changes = world.changes(WORLDS.get(world.name, WorldConfig()))
    told = ", ".join(f"{path} {value}" for path, value in changes.items())
    return f"{world.name} with {told}" if told else world.name
