"""Start poses and random thrusts shared by the tests of the physics."""

import jax
import numpy as np

from salpchain.physics.chain import Chain, at_rest

LINK = 0.07  # m, between the centres of two units


def bent(rng, batch, num, bend):
    """Positions and angles of chains with closed joints, each link turned by up to `bend` rad."""
    turns = rng.uniform(-bend, bend, (batch, num - 1))
    turns[:, 0] = rng.uniform(0, 2 * np.pi, batch)
    direction = np.cumsum(turns, 1)
    ahead = LINK * np.stack([np.cos(direction), np.sin(direction)], -1)
    position = np.concatenate([np.zeros((batch, 1, 2)), np.cumsum(ahead, 1)], 1)
    angle = np.concatenate([direction[:, :1], direction], 1)
    return position.astype(np.float32), angle.astype(np.float32)


def chains_at(position, angle) -> Chain:
    """A batch of motionless chains through these poses."""
    return jax.vmap(at_rest)(jax.numpy.array(position), jax.numpy.array(angle))
