"""What each unit observes: `table1`, the paper's, and `body`, the unit's own view (DESIGN 4)."""

from collections.abc import Callable

import jax.numpy as jnp
from jaxtyping import Array, Float

from salpchain.domain.pose import LINK
from salpchain.physics.chain import Chain, heading, wrap

View = Callable[
    [Chain, Float[Array, "unit 2"], Float[Array, " unit"]], Float[Array, "unit feature"]
]


def table1(
    chain: Chain, target: Float[Array, "unit 2"], thrust: Float[Array, " unit"]
) -> Float[Array, "unit 24"]:
    """The 24 numbers of the paper's Table 1, in its order, in world axes."""
    units = chain.units
    index = jnp.arange(units.angle.shape[0])
    force = _alive(chain, thrust[:, None] * heading(units.angle))
    columns = [
        (index[:, None] >> jnp.arange(4)) & 1,
        units.position,
        units.velocity,
        wrap(units.angle)[:, None],
        units.angular_velocity[:, None],
        units.velocity - _mean(chain, units.velocity),
        units.position - _mean(chain, units.position),
        units.position - _mean(chain, target),
        target - units.position,
        _bearings(chain),
        *_neighbours(chain, force),
    ]
    return _alive(chain, jnp.concatenate(columns, axis=-1))


def body(
    chain: Chain, target: Float[Array, "unit 2"], thrust: Float[Array, " unit"]
) -> Float[Array, "unit 22"]:
    """22 numbers in the unit's own axes, of much the same size at any length and distance."""
    units = chain.units
    error = target - units.position
    between = _mean(chain, target) - _mean(chain, units.position)
    to_previous, to_next = _vectors(chain, units.position)
    target_to_previous, target_to_next = _vectors(chain, target)
    vectors = [
        5 * units.velocity,
        to_previous / LINK,
        to_next / LINK,
        target_to_previous / LINK,
        target_to_next / LINK,
        error / (jnp.linalg.norm(error, axis=-1, keepdims=True) + 0.01),
        jnp.broadcast_to(5 * _mean(chain, units.velocity), error.shape),
    ]
    far = [
        error,
        jnp.broadcast_to(between, error.shape),
        units.position - _mean(chain, units.position),
    ]
    own = [_to_own(chain, x) for x in vectors] + [compress(_to_own(chain, x)) for x in far]
    single = [units.angular_velocity[:, None] / 3, _place(chain)[:, None]]
    return _alive(chain, jnp.concatenate(own + single, axis=-1))


def compress(x: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """sign(x) log(1 + 5 |x|): metres far away stay in the range seen near by."""
    return jnp.sign(x) * jnp.log1p(5 * jnp.abs(x))


def _alive(chain: Chain, values: Float[Array, "unit _"]) -> Float[Array, "unit _"]:
    return jnp.where(chain.present[:, None], values, 0.0)


def _mean(chain: Chain, values: Float[Array, "unit 2"]) -> Float[Array, "2"]:
    """Mean over the present units."""
    return _alive(chain, values).sum(axis=0) / jnp.maximum(chain.present.sum(), 1)


def _to_own(chain: Chain, vector: Float[Array, "unit 2"]) -> Float[Array, "unit 2"]:
    """World vectors in each unit's axes: along the unit, and along its heading."""
    cosine, sine = jnp.cos(chain.units.angle), jnp.sin(chain.units.angle)
    x, y = vector[:, 0], vector[:, 1]
    return jnp.stack([cosine * x + sine * y, cosine * y - sine * x], axis=-1)


def _neighbours(chain: Chain, values: Float[Array, "unit k"]) -> list[Float[Array, "unit k"]]:
    """What the previous and what the next linked unit has; zero where there is none."""
    joined = chain.joined[:, None]
    none = jnp.zeros_like(values[:1])
    previous = jnp.concatenate([none, jnp.where(joined, values[:-1], 0.0)])
    following = jnp.concatenate([jnp.where(joined, values[1:], 0.0), none])
    return [previous, following]


def _vectors(chain: Chain, points: Float[Array, "unit 2"]) -> list[Float[Array, "unit 2"]]:
    """From each unit's point to those of the previous and of the next linked unit."""
    step = jnp.where(chain.joined[:, None], points[1:] - points[:-1], 0.0)
    none = jnp.zeros_like(points[:1])
    return [jnp.concatenate([none, -step]), jnp.concatenate([step, none])]


def _bearings(chain: Chain) -> Float[Array, "unit 2"]:
    """Bearing of the previous and of the next unit from each unit's own angle (rad, wrapped)."""
    exists = _neighbours(chain, chain.present[:, None].astype(chain.units.angle.dtype))
    towards = _vectors(chain, chain.units.position)
    bearings = [
        jnp.where(there[:, 0] > 0, wrap(jnp.arctan2(v[:, 1], v[:, 0]) - chain.units.angle), 0.0)
        for there, v in zip(exists, towards, strict=True)
    ]
    return jnp.stack(bearings, axis=-1)


def _place(chain: Chain) -> Float[Array, " unit"]:
    """Place along the chain, from -1 (first unit) to 1 (last)."""
    index = jnp.arange(chain.present.shape[0])
    return 2 * index / jnp.maximum(chain.present.sum() - 1, 1) - 1.0


OBSERVATIONS: dict[str, View] = {"table1": table1, "body": body}
