"""Actor and critic on a shared graph trunk (paper section 4.1; DESIGN section 5)."""

from collections.abc import Callable
from typing import Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from salpchain.control.config import ControlConfig
from salpchain.control.gcn import WIDTH, gcn
from salpchain.control.graph import GRAPHS, Graph
from salpchain.control.layers import Linear, gelu, linear

START_LOG_STD = -0.5  # of every action (DESIGN section 5)
ACTOR_GAIN = 0.01  # of the actor's last layer, so that training starts from no thrust (chosen)


@runtime_checkable
class Trunk(Protocol):
    """A graph network: features of each unit from what all units observe."""

    def __call__(self, x: Float[Array, "unit inputs"], graph: Graph) -> Float[Array, "unit 128"]:
        """Features (unit, 128)."""
        ...


TRUNKS: dict[str, Callable[[PRNGKeyArray, int], Trunk]] = {"gcn": gcn}


class Head(eqx.Module):
    """Linear layers with GELU between them."""

    layers: list[Linear]

    def __call__(self, x: Float[Array, "*rows 128"]) -> Float[Array, "*rows outputs"]:
        """(..., 128) to (..., outputs)."""
        for layer in self.layers[:-1]:
            x = gelu(layer(x))
        return self.layers[-1](x)


class ActorCritic(eqx.Module):
    """A Gaussian over each unit's action, and the value of the whole chain."""

    trunk: Trunk
    actor: Head
    critic: Head
    score: Head
    log_std: Float[Array, "*slots act"]
    graph: str = eqx.field(static=True)

    def __call__(
        self,
        obs: Float[Array, "unit inputs"],
        present: Bool[Array, " unit"],
        joined: Bool[Array, " link"],
    ) -> tuple[Float[Array, "unit act"], Float[Array, ""]]:
        """Mean action of each unit, and the value."""
        features = self.features(obs, present, joined)
        return self.actor(features), self.value(features, present)

    def act(
        self,
        obs: Float[Array, "unit inputs"],
        present: Bool[Array, " unit"],
        joined: Bool[Array, " link"],
    ) -> Float[Array, "unit act"]:
        """Mean action of each unit alone: what the deterministic policy does."""
        return self.actor(self.features(obs, present, joined))

    def features(self, obs: Array, present: Array, joined: Array) -> Float[Array, "unit 128"]:
        """What the trunk makes of the observations."""
        return self.trunk(obs, GRAPHS[self.graph](present, joined))

    def value(
        self, features: Float[Array, "unit 128"], present: Bool[Array, " unit"]
    ) -> Float[Array, ""]:
        """Value of the units' features, pooled by learned attention over the present units."""
        score = jnp.where(present, self.score(features)[:, 0], -jnp.inf)
        return self.critic(jax.nn.softmax(score) @ features)[0]


def actor_critic(
    key: PRNGKeyArray, config: ControlConfig, inputs: int, actions: int, length: int
) -> ActorCritic:
    """Fresh weights for units that observe `inputs` numbers and act with `actions`."""
    trunk_key, actor_key, critic_key, score_key = jr.split(key, 4)
    slots = () if config.shared_log_std else (length,)
    return ActorCritic(
        trunk=TRUNKS[config.model](trunk_key, inputs),
        actor=head(actor_key, [WIDTH, WIDTH, WIDTH, actions], ACTOR_GAIN),
        critic=head(critic_key, [WIDTH, WIDTH, WIDTH, 1]),
        score=head(score_key, [WIDTH, WIDTH, 1]),
        log_std=jnp.full((*slots, actions), START_LOG_STD),
        graph=config.graph,
    )


def head(key: PRNGKeyArray, sizes: list[int], last_gain: float = 1.0) -> Head:
    """Fresh layers of these sizes; the last one's weights are scaled."""
    keys = jr.split(key, len(sizes) - 1)
    gains = [1.0] * (len(sizes) - 2) + [last_gain]
    return Head([linear(*args) for args in zip(keys, sizes[:-1], sizes[1:], gains, strict=True)])
