"""What an action does besides thrust: units let go of the next one and take hold of it."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from salpchain.physics.docking import dockable, grip
from salpchain.physics.state import Chain, Physics
from salpchain.tasks.config import TaskConfig

LET_GO = -0.5  # second number of an action `grip` below which a unit lets go (chosen)


def with_grips(chain: Chain, config: TaskConfig) -> Chain:
    """The chain with links that can be cut and closed, where the action has a say in that."""
    return dockable(chain) if config.action == "grip" and chain.docking is None else chain


def gripped(
    chain: Chain, action: Float[Array, "unit act"], config: TaskConfig, physics: Physics
) -> Chain:
    """The chain after its units let go or took hold, before they thrust.

    Under actions that say nothing of it, units of a chain that can dock hold what they have, and
    take hold where they can.
    """
    if chain.docking is None:
        return chain
    hold = jnp.ones_like(chain.linked)
    if config.action == "grip":
        hold = action[:-1, 1] >= LET_GO
    return grip(chain, hold, physics)
