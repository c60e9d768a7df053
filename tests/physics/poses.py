"""Chains and measures shared by the tests of the physics."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from salpchain.physics.state import Chain, at_rest

LINK = 0.07  # m, between the centres of two units
UNIT_MASS = LINK_MASS = 1.0  # kg
UNIT_INERTIA = UNIT_MASS * (0.04**2 + 0.05**2) / 12  # kg m2, a box of 0.04 m x 0.05 m
LINK_INERTIA = LINK_MASS * LINK**2 / 12  # kg m2, a rod


def bent(rng, batch, num, bend):
    """Positions and angles of chains with closed joints, each link turned by up to `bend` rad."""
    turns = rng.uniform(-bend, bend, (batch, num - 1))
    turns[:, 0] = rng.uniform(0, 2 * np.pi, batch)
    return along(np.cumsum(turns, 1))


def along(direction):
    """Positions and angles of chains whose links point in these directions, (batch, link) rad."""
    ahead = LINK * np.stack([np.cos(direction), np.sin(direction)], -1)
    position = np.concatenate([np.zeros_like(ahead[:, :1]), np.cumsum(ahead, 1)], 1)
    return position, np.concatenate([direction[:, :1], direction], 1)


def resting(position, angle) -> Chain:
    """A batch of motionless chains through these poses."""
    return jax.vmap(at_rest)(jnp.asarray(position, float), jnp.asarray(angle, float))


def lively(rng, num, bend=0.5, batch=None) -> Chain:
    """Chains in motion, their joints open by about a millimetre; one chain if `batch` is None."""
    chains = resting(*bent(rng, batch or 1, num, bend))

    def shake(x, size):
        return x + jnp.asarray(rng.uniform(-size, size, x.shape), x.dtype)

    # m, rad, m/s, rad/s: what full random thrust brings about
    sizes = (1e-3, 0.1, 0.2, 3.0)
    for part in ("units", "links"):
        fields = jax.tree.leaves(getattr(chains, part))
        shaken = [shake(x, size) for x, size in zip(fields, sizes, strict=True)]
        chains = eqx.tree_at(lambda c, p=part: jax.tree.leaves(getattr(c, p)), chains, shaken)
    return chains if batch else jax.tree.map(lambda x: x[0], chains)


def thrusts(rng, *shape):
    """Random thrusts in [-1, 1] N."""
    return jnp.asarray(rng.uniform(-1, 1, shape), float)


def opening(chain: Chain):
    """How far apart (m) each link's two ends are from the centres of their units, (..., link)."""
    half = LINK / 2 * jnp.stack([jnp.cos(chain.links.angle), jnp.sin(chain.links.angle)], -1)
    first = chain.links.position - half - chain.units.position[..., :-1, :]
    second = chain.links.position + half - chain.units.position[..., 1:, :]
    return jnp.maximum(*(jnp.linalg.norm(x, axis=-1) for x in (first, second)))


def in_double_precision(test):
    """The same test with 64-bit numbers."""

    @functools.wraps(test)
    def wrapped(*args, **kwargs):
        with jax.enable_x64(True):
            return test(*args, **kwargs)

    return wrapped


def largest_difference(one, other) -> float:
    """The largest absolute difference of any number in two trees of arrays."""
    pairs = zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True)
    return max(float(np.abs(np.asarray(x, float) - np.asarray(y, float)).max()) for x, y in pairs)
