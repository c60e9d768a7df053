"""Controllers simple enough to reason about."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from salpchain.controllers.policy import PolicyCard
from salpchain.tasks.state import State


class Constant(eqx.Module):
    """The same thrust on every unit, always; all such controllers share one compiled program."""

    thrust: Float[Array, ""] = eqx.field(converter=jnp.float32)

    @property
    def card(self) -> PolicyCard:
        """A controller of no settings."""
        return PolicyCard(name="constant")

    def act(self, state: State) -> Float[Array, "unit 1"]:
        """The constant."""
        return jnp.full((state.chain.present.shape[0], 1), self.thrust)
