"""What the faulty sensors of a live chain remember, a row of numbers of each unit between steps."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from salpchain.physics.state import Chain
from salpchain.world.sensing import Senses, Sensing


def width(sensing: Sensing | None) -> int:
    """Numbers that the sensors of a unit remember."""
    if sensing is None:
        return 0
    poses = 2 + sensing.most_delay  # what is told, the offset, and what was read before
    return 6 * poses + 2 + sensing.most_action_delay + 1


def remembered(
    sensing: Sensing | None,
    key: PRNGKeyArray,
    chain: Chain,
    memory: Float[Array, "unit number"],
    begins: Bool[Array, " unit"],
) -> Senses | None:
    """The sensors as they were after the last step; those of some units begin now."""
    if sensing is None:
        return None
    fresh, tree = jax.tree.flatten(_by_unit(sensing.start(key, chain, 1)))
    ends = np.cumsum([x[0].size for x in fresh])[:-1]
    parts = jnp.split(memory, ends, axis=1)
    leaves = []
    for new, part in zip(fresh, parts, strict=True):
        first = begins.reshape(-1, *(1,) * (new.ndim - 1))
        leaves.append(jnp.where(first, new, part.reshape(new.shape).astype(new.dtype)))
    return _by_unit(jax.tree.unflatten(tree, leaves))


def kept(senses: Senses | None, units: int) -> Float[Array, "unit number"]:
    """What the sensors remember from now on."""
    if senses is None:
        return jnp.zeros((units, 0))
    leaves = jax.tree.leaves(_by_unit(senses))
    return jnp.concatenate([x.astype(float).reshape(units, -1) for x in leaves], axis=1)


def _by_unit(senses: Senses) -> Senses:
    """With the axes of units and of steps exchanged, where there are steps."""
    steps = senses.past, senses.actions
    exchanged = jax.tree.map(lambda x: jnp.moveaxis(x, 0, 1), steps)
    return eqx.tree_at(lambda s: (s.past, s.actions), senses, exchanged)
