"""Worlds drawn for each episode from a `WorldConfig`."""

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any
from zlib import crc32

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
from jaxtyping import Array, Float, Int, PRNGKeyArray

from salpchain.dynamics.landsalp import LandSalp, chain_parts
from salpchain.dynamics.robot import Dynamics
from salpchain.dynamics.water import Water
from salpchain.given import instance
from salpchain.physics.state import Chain, Physics, Scalar, at_rest
from salpchain.ranges import Range
from salpchain.world.among import Chosen, chosen
from salpchain.world.config import (
    ONE,
    CurrentConfig,
    DynamicsConfig,
    SensingConfig,
    ThrusterConfig,
    WorldConfig,
)
from salpchain.world.current import Current, Shear, Sum, Uniform, Vortex, Wandering
from salpchain.world.placement import place_obstacles
from salpchain.world.presets import world_config
from salpchain.world.sensing import Sensing
from salpchain.world.thrusters import Thrusters
from salpchain.world.world import World

SPARED_STREAM = 8  # makes what an episode is spared independent of what it is not
ONE_SIDED_STREAM = 9  # and whether its jets push one way independent of the rest
NEVER = jnp.iinfo(jnp.int32).max  # the control step from which a thruster that never fails is dead


def draw_world(
    config: WorldConfig,
    key: PRNGKeyArray,
    slots: int,
    length: int | Int[Array, ""],
    steps: int | Int[Array, ""],
    ease: Scalar | None = None,
) -> World:
    """A world for one episode of a chain of `length` units of `slots`, at most `steps` long.

    A part of the config that is as in still water is None in the world, and a number that is fixed
    is fixed in the program. With `ease`, that share of the settings is spared besides.
    """
    given = config
    if config.spared.most > 0 or ease is not None:
        config = _sparing(config, jr.fold_in(key, SPARED_STREAM), ease)
    dynamics, current, thrusters, sensing = jr.split(key, 4)
    physics = _dynamics(config.dynamics, dynamics)
    return World(
        dynamics=physics,
        current=_current(config.current, current, length * physics.link_length),
        thrusters=_thrusters(config.thrusters, thrusters, slots, length, steps),
        sensing=_sensing(config.sensing, sensing),
        drawn_from=given,
        ease=ease,
    )


def _sparing(config: WorldConfig, key: PRNGKeyArray, ease: Scalar | None) -> WorldConfig:
    """The settings with some of them, each by itself, as in still water."""
    share_key, key = jr.split(key)
    share = _drawn(share_key, config.spared)
    share = share if ease is None else ease + (1 - ease) * share

    def which(path: str) -> Int[Array, ""]:
        spared = jr.bernoulli(jr.fold_in(key, crc32(path.encode())), share)
        return spared.astype(jnp.int32)

    kept = {name: getattr(config, name) for name in ("name", "obstacles", "spared")}
    dynamics = replace(config.dynamics, mass=ONE, drag=ONE, stiffness=ONE)
    share_of_jets = config.thrusters.one_sided_share
    thrusters = ThrusterConfig(one_sided=share_of_jets < 1, one_sided_share=share_of_jets)
    return chosen((config, WorldConfig(dynamics=dynamics, thrusters=thrusters, **kept)), which)


def with_obstacles(
    world: World, key: PRNGKeyArray, chain: Chain, target: Float[Array, "unit 2"]
) -> World:
    """The world with the obstacles that its settings have, clear of a start and a target (m)."""
    if world.drawn_from is None:
        return world
    placed = place_obstacles(world.drawn_from.obstacles, key, chain, target, world.dynamics)
    return replace(world, obstacles=placed)


WorldLike = World | WorldConfig | Physics | str | None


def as_world(given: WorldLike) -> World:
    """A world: itself, the still one, that with these physics, or one that each episode draws.

    Raises:
        InputError: another kind of world, or an unknown name of one.
    """
    if given is None:
        return World()
    if isinstance(given, World):
        return given
    if isinstance(given, Physics):
        return World(given)
    config = world_config(given) if isinstance(given, str) else given
    instance("world", config, WorldConfig, "a World, a WorldConfig, a Physics or a name of one")
    if config.is_still:
        return World()

    def example(key: PRNGKeyArray) -> World:
        chain, target = at_rest(jnp.zeros((2, 2)), jnp.zeros(2)), jnp.zeros((2, 2))
        return with_obstacles(draw_world(config, key, 2, 2, 1), key, chain, target)

    traced = eqx.filter_eval_shape(example, jr.key(0))  # its arrays are drawn for each episode
    return eqx.filter(traced, lambda leaf: isinstance(leaf, jax.ShapeDtypeStruct), inverse=True)


def _is_plain(config: ThrusterConfig | SensingConfig) -> bool:
    """Whether a part of the settings is as in still water, whichever world is chosen."""
    plain = type(config)()
    values = [(getattr(config, one.name), getattr(plain, one.name)) for one in fields(config)]
    return all(type(value) is type(still) and value == still for value, still in values)


def _drawn(key: PRNGKeyArray, given: Range | Chosen) -> Scalar:
    """Uniform in the range; a fixed number stays a constant of the program."""
    return given.low if given.is_fixed else jr.uniform(key, minval=given.low, maxval=given.high)


def _whole(key: PRNGKeyArray, given: Range | Chosen) -> Int[Array, ""]:
    """A whole number of the range, each equally likely."""
    return jr.randint(key, (), _rounded(given.low), _rounded(given.high) + 1)


def _rounded(number: Any) -> Any:
    return round(number) if isinstance(number, float) else jnp.round(number).astype(jnp.int32)


def _dynamics(config: DynamicsConfig, key: PRNGKeyArray) -> Physics:
    plain, keys = Physics(), jr.split(key, 3)
    substeps = config.substeps * plain.substeps
    if config.kind != "vmas":
        return _robot(config, keys)

    def times(value: Scalar, given: Range | Chosen, key: PRNGKeyArray) -> Any:
        return value if given == Range(1.0, 1.0) else value * _drawn(key, given)

    return Physics(
        unit_mass=times(plain.unit_mass, config.mass, keys[0]),
        link_mass=times(plain.link_mass, config.mass, keys[0]),
        drag=times(plain.drag, config.drag, keys[1]),
        joint_stiffness=times(plain.joint_stiffness, config.stiffness, keys[2]),
        angle_stiffness=times(plain.angle_stiffness, config.stiffness, keys[2]),
        substeps=substeps,
    )


def _robot(config: DynamicsConfig, keys: Any) -> Dynamics:
    mass, drag, stiffness = (
        _drawn(key, given)
        for key, given in zip(keys, (config.mass, config.drag, config.stiffness), strict=True)
    )
    alike: dict[str, Any] = {"thickness": drag, "angle_stiffness": config.spring * stiffness}
    if config.kind == "landsalp":
        parts = chain_parts(config.across)
        return LandSalp(parts=parts, substeps=config.substeps * LandSalp.substeps, **alike)
    return Water(inertia=mass, substeps=config.substeps * Water.substeps, **alike)


def _direction(key: PRNGKeyArray) -> Float[Array, "2"]:
    angle = jr.uniform(key, maxval=2 * jnp.pi)
    return jnp.stack([jnp.cos(angle), jnp.sin(angle)])


def _current(config: CurrentConfig, key: PRNGKeyArray, extent: Scalar) -> Current | None:
    """The sum of the currents that the config has; `extent` (m) is the length of the chain."""
    keys, parts = jr.split(key, 8), []
    if config.speed.most > 0:
        parts.append(Uniform(_drawn(keys[0], config.speed) * _direction(keys[1])))
    if config.shear.most > 0:
        angle = jr.uniform(keys[3], maxval=2 * jnp.pi)
        parts.append(Shear(_drawn(keys[2], config.shear), angle))
    if config.vortex.most > 0:
        speed, where, turn = jr.split(keys[4], 3)
        way = extent * jr.uniform(where, minval=0.5, maxval=1.5)
        parts.append(
            Vortex(
                _drawn(speed, config.vortex) * jr.rademacher(turn, ()).astype(float),
                _drawn(keys[5], config.vortex_radius),
                way * _direction(keys[6]),
            )
        )
    if config.wander.most > 0:
        deviation, time, now = jr.split(keys[7], 3)
        drawn = _drawn(deviation, config.wander)
        parts.append(
            Wandering(drawn, _drawn(time, config.relaxation), now=drawn * jr.normal(now, (2,)))
        )
    return _sum(parts)


def _sum(parts: Sequence[Current]) -> Current | None:
    if len(parts) < 2:
        return parts[0] if parts else None
    return Sum(tuple(parts))


def _thrusters(
    config: ThrusterConfig,
    key: PRNGKeyArray,
    slots: int,
    length: int | Int[Array, ""],
    steps: int | Int[Array, ""],
) -> Thrusters | None:
    if _is_plain(config):
        return None
    order, dead, failing, when, gain, lag = jr.split(key, 6)
    one_sided = config.one_sided
    if config.one_sided_share < 1:
        drawn = jr.bernoulli(jr.fold_in(key, ONE_SIDED_STREAM), config.one_sided_share)
        one_sided = drawn & one_sided
    rank = _ranks(order, slots, length)
    gains = jr.uniform(gain, (slots,), minval=config.gain.low, maxval=config.gain.high)
    num_dead = jnp.round(_drawn(dead, config.dead) * length)
    gains = jnp.where(rank < num_dead, 0.0, gains)
    fails_at = None
    if config.failing.most > 0:
        num_failing = jnp.round(_drawn(failing, config.failing) * length)
        fails = (num_dead <= rank) & (rank < num_dead + num_failing)
        at = jr.randint(when, (slots,), 0, steps)
        fails_at = jnp.where(fails, at, NEVER)
    return Thrusters(
        gain=gains,
        fails_at=fails_at,
        lag=_drawn(lag, config.lag) if config.lag.most > 0 else None,
        one_sided=one_sided,
    )


def _ranks(key: PRNGKeyArray, slots: int, length: int | Int[Array, ""]) -> Int[Array, " unit"]:
    """The place of each unit in a random order of those present; dead slots come last."""
    drawn = jnp.where(jnp.arange(slots) < length, jr.uniform(key, (slots,)), 2.0)
    return jnp.argsort(jnp.argsort(drawn))


def _sensing(config: SensingConfig, key: PRNGKeyArray) -> Sensing | None:
    if _is_plain(config):
        return None
    keys = dict(zip((one.name for one in fields(config)), jr.split(key, 11), strict=True))

    def drawn(name: str) -> Scalar:
        return _drawn(keys[name], getattr(config, name))

    def whole(name: str) -> Int[Array, ""]:
        return _whole(keys[name], getattr(config, name))

    position, angle = drawn("position"), drawn("angle")
    return Sensing(
        position=position,
        angle=angle,
        velocity=position,
        turning=angle,
        position_bias=drawn("position_bias"),
        angle_bias=drawn("angle_bias"),
        stuck=drawn("stuck"),
        stuck_steps=whole("stuck_steps"),
        dropped=drawn("dropped"),
        dropped_steps=whole("dropped_steps"),
        delay=whole("delay"),
        most_delay=round(config.delay.most),
        action_delay=whole("action_delay"),
        most_action_delay=round(config.action_delay.most),
        repeat=whole("repeat"),
        repeats=config.repeat.most > 1,
    )
