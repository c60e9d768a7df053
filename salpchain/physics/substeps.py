"""One control step for a whole batch of chains: the substep loop of VMAS 1.5.2 `World.step`.

Arrays have the batch last: vectors are (2, body, batch), all else (body, batch). Few and wide
operations: a CPU pays for each.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from salpchain.physics.joints import FORCES, JointForces, angle_torque


class Motion(NamedTuple):
    """Where bodies are and how they move."""

    position: Float[Array, "2 body batch"]
    angle: Float[Array, "body batch"]
    velocity: Float[Array, "2 body batch"]
    angular_velocity: Float[Array, "body batch"]


class Load(NamedTuple):
    """Forces (N) and torques (N m) on units."""

    force: Float[Array, "2 unit batch"]
    torque: Float[Array, "unit batch"]


class Anchor(NamedTuple):
    """Where the second ends of links rest, from their units: nearer in each substep."""

    start: Float[Array, "2 link batch"]  # m, before the control step
    nearer: Float[Array, "link batch"]  # share of it that the step takes up


class Rig(NamedTuple):
    """What stays the same during a control step."""

    physics: Any  # state.Physics, scalars or (batch,)
    rest_angle: Float[Array, "link 2 batch"]
    present: Bool[Array, "unit batch"]
    joined: Bool[Array, "link batch"]
    fence: Float[Array, "*batch"] | None
    obstacles: Any = None  # obstacles.Solids
    # Where links can be cut: first joints that act, and where second ends rest
    held: Bool[Array, "link batch"] | None = None
    anchor: Anchor | None = None

    @property
    def dt(self) -> Any:
        """Length of a substep (s)."""
        return self.physics.control_step / self.physics.substeps


class Substate(NamedTuple):
    """Both kinds of body, and what is kept up with them."""

    units: Motion
    links: Motion
    half: Float[Array, "2 link batch"]  # m, from a link's centre to its second end
    touching: Bool[Array, " batch"]  # whether two units have pushed each other so far
    blocked: Bool[Array, " batch"] | None  # whether an obstacle has pushed a unit so far
    impulse: Float[Array, " batch"] | None = None  # N s, of obstacles on units so far


class Moved(NamedTuple):
    """Both kinds of body after a control step."""

    units: Motion
    links: Motion
    touching: Bool[Array, " batch"]  # whether two units pushed each other on the way
    blocked: Bool[Array, " batch"] | None  # whether an obstacle pushed a unit; None without any
    impulse: Float[Array, " batch"] | None = None  # N s, of obstacles on units, where asked for


class Push(NamedTuple):
    """How units are pushed in a substep, beside their own thrust and their joints."""

    # Whether any unit of the batch may be pushed; None in operations that have derivatives of both
    # modes, for which it is as if any may.
    ever: Bool[Array, ""] | None
    load: Callable[[], Float[Array, "3 unit batch"]]  # force (N, x and y), torque (N m)


Pusher = Callable[[Motion], Push]


def run_substeps(
    rig: Rig,
    units: Motion,
    links: Motion,
    push: Load,
    contact: Pusher | None,
    obstruction: Pusher | None = None,
    impulse: Float[Array, " batch"] | None = None,
) -> Moved:
    """Both kinds of body after all substeps, with the loads of contact between units and with
    obstacles computed in each if given.

    That of obstacles is added to `impulse`. The loop is not unrolled: XLA then fuses the transposes
    around it into every substep.
    """
    half = rig.physics.link_length / 2 * jnp.stack([jnp.cos(links.angle), jnp.sin(links.angle)])
    apart = jnp.zeros(units.angle.shape[-1], bool)
    free = None if rig.obstacles is None else apart
    state = Substate(units, links, half, apart, free, impulse)
    keep = 1 - rig.physics.drag

    def substep(index: Array, state: Substate) -> Substate:
        load, touching, blocked = push, state.touching, state.blocked
        if contact is not None:
            load, touching = _pushed_by(contact, state.units, load, touching)
        state = state._replace(touching=touching)
        if obstruction is not None:
            before = load.force
            load, blocked = _pushed_by(obstruction, state.units, load, blocked)
            state = state._replace(blocked=blocked)
            if state.impulse is not None:
                more = jnp.sqrt(jnp.square(load.force - before).sum(axis=0)).sum(axis=0)
                state = state._replace(impulse=state.impulse + more * rig.dt)
        return _substep(rig, state, load, jnp.where(index == 0, keep, 1.0), index)

    state = jax.lax.fori_loop(0, rig.physics.substeps, substep, state)
    return Moved(state.units, state.links, state.touching, state.blocked, state.impulse)


def _pushed_by(pusher: Pusher, units: Motion, load: Load, flag: Any) -> tuple[Load, Any]:
    """The load with what the pusher adds, and the flag of chains that it has pushed so far."""
    push = pusher(units)

    def pushed() -> tuple[Load, Array]:
        more = push.load().astype(units.angle.dtype)
        by = (more[:2] != 0).any(axis=(0, 1))
        return Load(load.force + more[:2], load.torque + more[2]), flag | by

    return pushed() if push.ever is None else jax.lax.cond(push.ever, pushed, lambda: (load, flag))


def _substep(rig: Rig, state: Substate, load: Load, keep: Array, index: Array) -> Substate:
    units, links, half = state[:3]
    joints = _joints(rig, units, links, half, index)
    couple = joints.first - joints.second
    twist = half[0] * couple[1] - half[1] * couple[0]
    on_links = Load(
        -(joints.first + joints.second), twist - joints.first_torque - joints.second_torque
    )
    on_units = Load(
        load.force + _gather(joints.first, joints.second),
        load.torque + _gather(joints.first_torque, joints.second_torque),
    )
    physics = rig.physics
    links = _integrate(rig, links, on_links, physics.link_mass, physics.link_inertia, keep)
    units = _integrate(rig, units, on_units, physics.unit_mass, physics.unit_inertia, keep)
    half = _turn(half, rig.dt * links.angular_velocity)
    return state._replace(units=units, links=links, half=half)


def _joints(rig: Rig, units: Motion, links: Motion, half: Array, index: Array) -> JointForces:
    physics, joined = rig.physics, rig.joined
    acts = joined if rig.held is None else rig.held, joined
    second = links.position + half - units.position[:, 1:]
    if rig.anchor is not None:
        part = (index + 1) / physics.substeps
        second -= rig.anchor.start * (1 - part * rig.anchor.nearer)
    ends = links.position - half - units.position[:, :-1], second
    bends = (
        links.angle - (units.angle[:-1] + rig.rest_angle[:, 0]),
        links.angle - (units.angle[1:] + rig.rest_angle[:, 1]),
    )
    pull, constants = FORCES[physics.joint_derivative], (physics.joint_stiffness, physics.softness)
    forces = (pull(end, here, *constants) for end, here in zip(ends, acts, strict=True))
    torques = (
        angle_torque(bend, here, physics.angle_stiffness)
        for bend, here in zip(bends, acts, strict=True)
    )
    return JointForces(*forces, *torques)


def _gather(first: Array, second: Array) -> Array:
    """The sum over the two links of each unit, of what they exert on it."""
    none = jnp.zeros_like(first[..., :1, :])
    return jnp.concatenate([first, none], axis=-2) + jnp.concatenate([none, second], axis=-2)


def _integrate(
    rig: Rig, bodies: Motion, load: Load, mass: Any, inertia: Any, keep: Array
) -> Motion:
    """Velocity first, then position (semi-implicit Euler); `keep` is the share left by drag."""
    dt = rig.dt
    velocity = bodies.velocity * keep + load.force * (dt / mass)
    spin = bodies.angular_velocity * keep + load.torque * (dt / inertia)
    position = bodies.position + velocity * dt
    if rig.fence is not None:
        position = jnp.clip(position, -rig.fence, rig.fence)
    return Motion(position, bodies.angle + spin * dt, velocity, spin)


def _turn(vector: Float[Array, "2 link batch"], angle: Array) -> Float[Array, "2 link batch"]:
    """The vector turned by a small angle, by its Taylor series.

    A link turns by at most a few hundredths of a radian in a substep, where the series is exact to
    single precision; sine and cosine proper are taken once for each control step.
    """
    square = angle * angle
    sine = angle * (1 - square * (1 / 6 - square * (1 / 120)))
    versine = square * (1 / 2 - square * (1 / 24))
    across = jnp.stack([-vector[1], vector[0]])
    return vector + (across * sine - vector * versine)
