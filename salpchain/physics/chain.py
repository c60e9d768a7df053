"""One control step of a chain of units and links."""

from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from salpchain.physics.batching import over_the_batch
from salpchain.physics.broadphase import far_pairs, near_solids
from salpchain.physics.contact import among_all_units, among_units
from salpchain.physics.docking import tightened
from salpchain.physics.obstacles import Obstacles, every_obstruction, obstruction, solids
from salpchain.physics.state import Bodies, Chain, Physics
from salpchain.physics.substeps import Load, Motion, Pusher, Rig, run_substeps
from salpchain.switches import standard_promotion
from salpchain.xla import materialise


@standard_promotion
def step(
    chain: Chain,
    thrust: Float[Array, " unit"],
    physics: Physics | None = None,
    fence: Float[Array, ""] | float | None = None,
    contact: bool = True,
    obstacles: Obstacles | None = None,
) -> Chain:
    """The chain one control step (0.1 s) later, under a thrust (N) held for the whole step.

    Arithmetic of VMAS 1.5.2 `World.step`: semi-implicit Euler in substeps, drag once at the
    start. `fence` (m) clamps all positions to abs(x), abs(y) <= fence; None leaves it off.
    `contact` is that of units with each other; `obstacles` push units in any case. None compiles
    to a program that knows no obstacles.
    Written for one chain; under `jax.vmap` the whole batch steps together with the batch as
    the last axis, and contact costs next to nothing while nothing is near.
    """
    around = None if obstacles is None else solids(obstacles)
    moved = _step(contact, chain, thrust, physics or Physics(), fence, around)
    return eqx.tree_at(lambda c: jax.tree.leaves(_changing(c)), chain, moved)


def _changing(chain: Chain) -> tuple[Any, ...]:
    hidden = () if chain.docking is None else (chain.docking.slack, chain.docking.twist)
    return chain.units, chain.links, chain.touching, chain.blocked, chain.impulse, *hidden


def _stepped(
    differentiable: bool,
    contact: bool,
    chain: Chain,
    thrust: Array,
    physics: Physics,
    fence: Any,
    obstacles: Any,
) -> list[Array]:
    """What `step` changes, in the order of `_changing`; the batch last in every array."""
    if not chain.present.size:  # a batch of none: nothing can touch
        contact, obstacles = False, None
    rig = Rig(physics, chain.rest_angle, chain.present, chain.joined, fence, obstacles)
    impulse, left = None, ()
    if chain.docking is not None:
        rig, left = _dockable(rig, chain)
    if chain.impulse is not None and obstacles is not None:
        impulse = jnp.zeros_like(chain.units.angle[0])
    units, links = _motion(chain.units, chain.present), _motion(chain.links, chain.held)
    push = jnp.where(chain.present, thrust, 0.0) * _across(units.angle)
    pushers = (_all_pushers if differentiable else _near_pushers)(rig, units, contact)
    load = Load(push, jnp.zeros_like(units.angle))
    moved = run_substeps(rig, units, links, load, *pushers, impulse)
    flags = [moved.touching]
    if chain.blocked is not None:
        flags.append(jnp.zeros_like(moved.touching) if moved.blocked is None else moved.blocked)
    if chain.impulse is not None:
        none = jnp.zeros_like(chain.units.angle[0])
        flags.append(none if moved.impulse is None else moved.impulse)
    return [*_fields(moved.units), *_fields(moved.links), *flags, *left]


def _dockable(rig: Rig, chain: Chain) -> tuple[Rig, tuple[Array, Array]]:
    """The rig of a chain whose links can be cut, and the slack and twist of its joints after."""
    slack, twist, anchor = tightened(chain, rig.physics)
    rest = rig.rest_angle.at[:, 1].add(twist)
    # Otherwise every substep would compute them anew
    never = chain.present.sum() < 0
    rest, joined, held, anchor = materialise((rest, chain.joined, chain.held, anchor), never)
    rig = rig._replace(rest_angle=rest, joined=joined, held=held, anchor=anchor)
    return rig, (slack, twist)


_step = over_the_batch(partial(_stepped, False), partial(_stepped, True))

Pushers = tuple[Pusher | None, Pusher | None]  # other units, obstacles


def _near_pushers(rig: Rig, units: Motion, contact: bool) -> Pushers:
    """What pushes units where it is near."""
    others = obstacles = None
    if contact and len(units.angle) > 1:
        others = partial(among_units, rig, far_pairs(rig, units))
    if rig.obstacles is not None:
        obstacles = partial(obstruction, rig, near_solids(rig, units))
    return others, obstacles


def _all_pushers(rig: Rig, units: Motion, contact: bool) -> Pushers:
    """The same without loops of unknown length, so that it can be differentiated backwards too."""
    others = partial(among_all_units, rig) if contact and len(units.angle) > 1 else None
    return others, None if rig.obstacles is None else partial(every_obstruction, rig)


def _motion(bodies: Bodies, alive: Array) -> Motion:
    """Bodies with the two coordinates first; dead slots at rest."""

    def still(velocity: Array) -> Array:
        return jnp.where(alive, velocity, 0.0)

    return Motion(
        jnp.swapaxes(bodies.position, 0, 1),
        bodies.angle,
        still(jnp.swapaxes(bodies.velocity, 0, 1)),
        still(bodies.angular_velocity),
    )


def _fields(motion: Motion) -> tuple[Array, ...]:
    """The fields of `Bodies`, in their order."""
    position, velocity = (jnp.swapaxes(x, 0, 1) for x in (motion.position, motion.velocity))
    return position, motion.angle, velocity, motion.angular_velocity


def _across(angle: Array) -> Array:
    """`heading` with the coordinates first."""
    return jnp.stack([-jnp.sin(angle), jnp.cos(angle)])
