"""Links that are cut and closed while a chain swims, within the compiled step.

Slots keep their order: link i joins units i and i + 1, so a unit has two joints at most and no ring
can close. What a cut leaves is told in `state.Docking`.
"""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from salpchain.errors import InputError
from salpchain.given import instance, told, whole
from salpchain.physics.batching import over_the_batch
from salpchain.physics.derivatives import root
from salpchain.physics.joints import CLOSED
from salpchain.physics.state import Chain, Docking, Latch, Physics
from salpchain.physics.substeps import Anchor


def dockable(chain: Chain, latch: Latch | None = None, record: bool = False) -> Chain:
    """The chain with links that can be cut and closed; those that act are closed.

    With `record`, how each closes is kept.
    """
    none, latch = jnp.zeros_like(chain.links.angle), latch or Latch()
    docking = Docking(none, none, latch=latch)
    if record:
        caught, catches = jnp.zeros((*none.shape, 3), none.dtype), none.astype(jnp.int32)
        docking = Docking(none, none, caught, catches, latch)
    return eqx.tree_at(lambda c: c.docking, chain, docking, is_leaf=lambda x: x is None)


def grip(chain: Chain, hold: Bool[Array, " link"], physics: Physics) -> Chain:
    """The chain before its next control step: every link that is not to `hold` is cut, and every
    cut one that is closes if its free end is near the unit, in line with it and slow (`Latch`).

    From then on it counts as `linked`; `Docking.slack` and `twist` say how far it still is from
    closed. The chain must be `dockable`.
    """
    after = _grip(None, chain, hold, physics)
    return eqx.tree_at(_gripped, chain, after)


def _gripped(chain: Chain) -> tuple[Any, ...]:
    """What a grip changes."""
    docking: Any = chain.docking
    kept = () if docking.caught is None else (docking.caught, docking.catches)
    return chain.linked, chain.rest_angle, docking.slack, docking.twist, *kept


@over_the_batch
def _grip(_: None, chain: Chain, hold: Array, physics: Physics) -> tuple[Array, ...]:
    docking: Any = chain.docking
    latch: Latch = docking.latch
    gap, bend, speed = _off(chain, physics)
    turns = 2 * jnp.pi * jnp.round(bend / (2 * jnp.pi))
    twist = bend - turns
    near = (gap <= latch.distance) & (jnp.abs(twist) <= latch.angle) & (speed <= latch.speed)
    caught = near & hold & ~chain.linked & chain.held
    linked = (chain.linked & hold) | caught
    rest = chain.rest_angle.at[:, 1].add(jnp.where(caught, turns, 0.0))
    slack = jnp.where(caught, gap, jnp.where(linked, docking.slack, 0.0))
    left = jnp.where(caught, twist, jnp.where(linked, docking.twist, 0.0))
    if docking.caught is None:
        return linked, rest, slack, left
    found = jnp.stack([gap, jnp.abs(twist), speed], axis=1)
    found = jnp.where(caught[:, None], found, docking.caught)
    return linked, rest, slack, left, found, docking.catches + caught


def tightened(chain: Chain, physics: Physics) -> tuple[Array, Array, Anchor]:
    """Slack (m) and twist (rad) of joints after the next control step, and where the second end of
    each link rests meanwhile: on the line on which it is, no farther than it is.

    Arrays have the batch last.
    """
    docking: Any = chain.docking
    latch: Latch = docking.latch
    gap = jnp.stack(_gap(chain, physics))
    size = root(gap[0] * gap[0] + gap[1] * gap[1])
    closer, turned = (rate * physics.control_step for rate in (latch.closing, latch.turning))
    slack = jnp.minimum(docking.slack, size)
    twist = docking.twist - jnp.clip(docking.twist, -turned, turned)
    left, some = jnp.maximum(slack - closer, 0.0), jnp.maximum(slack, CLOSED)
    anchor = Anchor(gap * (slack / jnp.maximum(size, CLOSED)), (slack - left) / some)
    return left, twist, anchor


def _gap(chain: Chain, physics: Physics) -> tuple[Array, Array]:
    """The second end of each link, from its unit (m)."""
    half, angle = physics.link_length / 2, chain.links.angle
    ends, units = chain.links.position, chain.units.position[1:]
    return (
        ends[:, 0] + half * jnp.cos(angle) - units[:, 0],
        ends[:, 1] + half * jnp.sin(angle) - units[:, 1],
    )


def _off(chain: Chain, physics: Physics) -> tuple[Array, Array, Array]:
    """How far the second end of each link is from its unit: m, rad (not wrapped) and m/s."""
    units, links = chain.units, chain.links
    half = physics.link_length / 2
    x, y = half * jnp.cos(links.angle), half * jnp.sin(links.angle)
    spin, gap = links.angular_velocity, _gap(chain, physics)
    speed = (
        links.velocity[:, 0] - spin * y - units.velocity[1:, 0],
        links.velocity[:, 1] + spin * x - units.velocity[1:, 1],
    )
    bend = links.angle - units.angle[1:] - chain.rest_angle[:, 1]
    return _size(*gap), bend, _size(*speed)


def _size(x: Array, y: Array) -> Array:
    return jnp.sqrt(x * x + y * y)


def openings(chain: Chain, physics: Physics) -> Float[Array, "link 3"]:
    """How far the second end of each link is from its unit: m, rad in [-pi, pi), m/s."""
    gap, bend, speed = _off(chain, physics)
    return jnp.stack([gap, jnp.mod(bend + jnp.pi, 2 * jnp.pi) - jnp.pi, speed], axis=1)


def shut(chain: Chain) -> Bool[Array, " link"]:
    """Links that act and whose second joint is closed without slack or twist."""
    docking = chain.docking
    if docking is None:
        return chain.joined
    return chain.joined & (docking.slack <= 0) & (docking.twist == 0)


def detach(chain: Chain, link: int) -> Chain:
    """One chain with a link cut; its body stays with the unit of the lower index.

    Raises:
        InputError: not one chain, or no such link, or it is cut already.
    """
    link = whole("link", link, least=0, most=_one(chain) - 2)
    if not bool(chain.joined[link]):
        raise InputError(f"link {link} cannot be cut: units {link} and {link + 1} are not joined")
    chain = chain if chain.docking is not None else dockable(chain)
    return eqx.tree_at(lambda c: c.linked, chain, chain.linked.at[link].set(False))


def attach(chain: Chain, unit: int, other: int, physics: Physics | None = None) -> Chain:
    """One chain with the link between two ends closed, gently, in the steps that follow.

    Raises:
        InputError: not one chain; units that are joined already, or that have no link between them;
            a ring; ends that are too far off for the latch.
    """
    last = _one(chain) - 1
    unit, other = sorted((whole("unit", unit, 0, last), whole("other", other, 0, last)))
    between = np.asarray(chain.joined)[unit:other]
    if other - unit > 1 or other == unit:
        if between.all():
            raise InputError(
                f"units {unit} and {other} are of one chain: joined, they would close a ring"
            )
        raise InputError(f"link i joins units i and i + 1: none is between {unit} and {other}")
    if between[0]:
        raise InputError(f"units {unit} and {other} are joined already")
    physics, chain = physics or Physics(), dockable(chain) if chain.docking is None else chain
    closed = grip(chain, chain.linked | (jnp.arange(last) == unit), physics)
    if not bool(closed.linked[unit]):
        gap, angle, speed = (abs(float(x)) for x in openings(chain, physics)[unit])
        latch: Any = chain.docking.latch if chain.docking else Latch()
        raise InputError(
            f"units {unit} and {other} are {gap:.3f} m, {angle:.2f} rad and {speed:.3f} m/s off:"
            f" at most {latch.distance} m, {latch.angle} rad and {latch.speed} m/s may be"
        )
    return closed


def _one(chain: Any) -> int:
    """The number of slots of one chain."""
    instance("chain", chain, Chain, "a salpchain.Chain")
    if chain.present.ndim != 1:
        raise InputError(f"one chain is meant, got a batch: {told(chain.present.shape)}")
    return len(chain.present)
