"""Thrusts that bring chains nearer to their targets at a given control step: Gauss-Newton steps.

The derivatives of where units are at the horizon by all thrusts are taken through the engine, for
a whole batch at once with the batch as the last axis, which a CPU is fast at. Contact is left out.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from salpchain.physics.state import Chain, Physics
from salpchain.physics.substeps import Load, Motion, Rig, run_substeps

AIM = 0.047  # m, distance of each unit at which nothing more is asked (chosen, goal: 0.0513)
INNER = 120  # steps on the linear problem (chosen)
SHARES = (1.0, 0.5, 0.2)  # of a step that are tried


class Problem(NamedTuple):
    """Swims, the batch last: where they begin, what they must come to, and when."""

    units: Motion
    links: Motion
    rest_angle: Float[Array, "link 2 swim"]
    present: Bool[Array, "unit swim"]
    live: Bool[Array, "unit swim"]  # whose thrusters push
    target: Float[Array, "2 unit swim"]
    horizon: Int[Array, " swim"]


def problem(
    chains: Chain,
    target: Float[Array, "swim unit 2"],
    horizon: np.ndarray,
    live: Bool[Array, "swim unit"] | None = None,
) -> Problem:
    """The problem of chains at rest, the swim first; all thrusters push if not said otherwise."""

    def motion(bodies: Any) -> Motion:
        place, speed = (
            jnp.moveaxis(x, 0, -1).swapaxes(0, 1) for x in (bodies.position, bodies.velocity)
        )
        return Motion(place, bodies.angle.T, speed, bodies.angular_velocity.T)

    there = jnp.moveaxis(jnp.asarray(target), 0, -1).swapaxes(0, 1)
    bodies, angle = (
        map(motion, (chains.units, chains.links)),
        jnp.moveaxis(chains.rest_angle, 0, -1),
    )
    present = chains.present.T
    pushing = present if live is None else present & live.T
    return Problem(*bodies, angle, present, pushing, there, jnp.asarray(horizon))


def ends(task: Problem, thrusts: Float[Array, "step unit swim"]) -> Float[Array, "2 unit swim"]:
    """Where the units are (m) at the horizon, less where they should be; 0 of dead slots."""
    joined = task.present[:-1] & task.present[1:]
    rig = Rig(Physics(), task.rest_angle, task.present, joined, None)

    def advance(now: tuple[Motion, Motion], thrust: Array) -> tuple[Any, Array]:
        units, links = now
        across = jnp.stack([-jnp.sin(units.angle), jnp.cos(units.angle)])
        push = Load(jnp.where(task.live, thrust, 0.0) * across, jnp.zeros_like(units.angle))
        moved = run_substeps(rig, units, links, push, None)
        return (moved.units, moved.links), moved.units.position

    every = jax.lax.scan(advance, (task.units, task.links), thrusts)[1]
    last = jnp.take_along_axis(every, (task.horizon - 1)[None, None, None], axis=0)[0]
    return jnp.where(task.present, last - task.target, 0.0)


def excess(off: Float[Array, "2 unit swim"]) -> Float[Array, "unit swim"]:
    """How far (m) each unit is beyond what is aimed at."""
    return jnp.maximum(jnp.sqrt(jnp.sum(off**2, axis=0) + 1e-12) - AIM, 0.0)


def loss(off: Float[Array, "2 unit swim"]) -> Float[Array, " swim"]:
    """Sum of the squares of `excess` (m2)."""
    return jnp.sum(excess(off) ** 2, axis=0)


@jax.jit
def sooner(
    task: Problem, thrusts: Float[Array, "step unit swim"], trust: Float[Array, " swim"]
) -> tuple[Array, Array, Array]:
    """Thrusts after one step, the trust (N) for the next, and the loss.

    No thrust changes by more than the trust; of several shares of the step, none too, that with the
    least loss is taken.
    """
    off, back = jax.vjp(partial(ends, task), thrusts)
    size = off.shape[0] * off.shape[1]
    seeds = jnp.eye(size).reshape(size, *off.shape[:2])[..., None] * jnp.ones(off.shape[-1])
    slope = jax.vmap(lambda seed: back(seed)[0])(seeds)  # (coordinate and unit, step, unit, swim)
    counts = jnp.arange(len(thrusts))[:, None] < task.horizon
    slope = jnp.where(counts[:, None], slope, 0.0)
    change = _linear(off, slope.reshape(*off.shape[:2], *thrusts.shape), thrusts, trust)
    tried = jnp.stack([thrusts + share * change for share in (0.0, *SHARES)])
    found = jax.lax.map(lambda one: loss(ends(task, one)), tried)
    best = jnp.argmin(found, axis=0)
    taken = jnp.take_along_axis(tried, best[None, None, None], axis=0)[0]
    more = jnp.where(best == 1, 1.5, jnp.where(best == 0, 0.3, 0.8))
    return taken, jnp.clip(trust * more, 0.003, 1.0), found.min(axis=0)


def _linear(off: Array, slope: Array, thrusts: Array, trust: Array) -> Array:
    """The change that makes the linear problem's loss small, by accelerated projected gradients."""
    low = jnp.maximum(-1.0 - thrusts, -trust)
    high = jnp.minimum(1.0 - thrusts, trust)
    bound = jnp.sum(slope**2, axis=(0, 1, 2, 3)) / 2 + 1e-9  # at least half the largest curvature

    def pull(change: Array) -> Array:
        there = off + jnp.einsum("cutns,tns->cus", slope, change)
        far = jnp.sqrt(jnp.sum(there**2, axis=0) + 1e-12)
        return jnp.einsum("cutns,cus->tns", slope, there * jnp.maximum(far - AIM, 0.0) / far)

    def improve(count: Array, now: tuple[Array, Array]) -> tuple[Array, Array]:
        change, ahead = now
        after = jnp.clip(ahead - pull(ahead) / bound, low, high)
        return after, after + count / (count + 3) * (after - change)

    return jax.lax.fori_loop(0, INNER, improve, (jnp.zeros_like(thrusts),) * 2)[0]
