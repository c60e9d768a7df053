"""The hand-written baseline: each unit thrusts towards its own target point."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from salpchain.controllers.policy import PolicyCard
from salpchain.physics.state import heading
from salpchain.switches import standard_promotion
from salpchain.tasks.checks import check_state
from salpchain.tasks.config import ACTION_SIZES
from salpchain.tasks.state import State

PULL = 5.0  # N per metre of error along the heading
DAMPING = 2.0  # N per m/s along the heading


class Greedy(eqx.Module):
    """thrust = clip(5 e.h - 2 v.h): e the error to the own target point, h the heading.

    It reads positions and velocities themselves, so it can stand beside a policy of any
    observation and action.
    """

    observation: str = eqx.field(static=True, default="body")
    action: str = eqx.field(static=True, default="thrust")

    def __check_init__(self) -> None:
        _ = self.card  # is refused with an unknown observation or action

    @property
    def card(self) -> PolicyCard:
        """Works at any length; was never trained."""
        return PolicyCard(name="greedy", observation=self.observation, action=self.action)

    @standard_promotion
    def act(self, state: State) -> Float[Array, "unit act"]:
        """Numbers in [-1, 1] for each unit: the thrust, and for `pair` its opposite too.

        Raises:
            InputError: a batch of states.
        """
        check_state(state, "act")
        units = state.seen.units
        ahead = heading(units.angle)
        error = jnp.sum((state.target - units.position) * ahead, axis=-1)
        speed = jnp.sum(units.velocity * ahead, axis=-1)
        return as_action(PULL * error - DAMPING * speed, self.action)


def as_action(thrust: Float[Array, " unit"], action: str) -> Float[Array, "unit act"]:
    """Thrusts (N), clipped to what a unit can do, as actions: for `pair` with their opposites, for
    `grip` with 0, which holds on."""
    thrust = jnp.clip(thrust, -1.0, 1.0)
    second = jnp.zeros_like(thrust) if action == "grip" else -thrust
    return jnp.stack([thrust, second], axis=-1)[:, : ACTION_SIZES[action]]
