"""The fixed-length baseline: one network that sees and steers a whole chain."""

from typing import Any

import equinox as eqx
import jax.random as jr
from jaxtyping import Array, Float, PRNGKeyArray

from salpchain.networks.layers import ACTOR_GAIN, WIDTH, Head, head


class MLP(eqx.Module):
    """Actor and critic on all observations in a row: n inputs -> 128 -> 128 -> n actions, or 1.

    Works at the length it was made for, and at no other.
    """

    actor: Head
    critic: Head
    log_std: Float[Array, "*slots act"]
    critic_observes: str = eqx.field(default="", static=True)
    recall: None = None

    def __call__(
        self,
        obs: Float[Array, "unit inputs"],
        present: Any = None,
        joined: Any = None,
        graph: Any = None,
        known: Any = None,
    ) -> tuple[Float[Array, "unit act"], Float[Array, ""]]:
        """Mean action of each unit, and the value; what else is given changes nothing."""
        return self.act(obs), self.critic(obs.reshape(-1))[0]

    def act(
        self,
        obs: Float[Array, "unit inputs"],
        present: Any = None,
        joined: Any = None,
        graph: Any = None,
    ) -> Float[Array, "unit act"]:
        """Mean action of each unit alone."""
        return self.actor(obs.reshape(-1)).reshape(obs.shape[0], -1)


def mlp(
    key: PRNGKeyArray,
    inputs: int,
    actions: int,
    length: int,
    log_std: Float[Array, "*slots act"],
) -> MLP:
    """A network for `length` units with fresh weights."""
    actor_key, critic_key = jr.split(key)
    sizes = [length * inputs, WIDTH, WIDTH]
    return MLP(
        actor=head(actor_key, [*sizes, length * actions], ACTOR_GAIN),
        critic=head(critic_key, [*sizes, 1]),
        log_std=log_std,
    )
