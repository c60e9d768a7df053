"""What a controller meets outside its training: noisy sensors, late thrusts, other physics."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
from jaxtyping import Array, Float

from salpchain.controllers.policy import Controller, PolicyCard, act, begin
from salpchain.errors import InputError
from salpchain.physics.state import Bodies, Physics
from salpchain.tasks.features import readings
from salpchain.tasks.observations import observe
from salpchain.tasks.state import State


class Noisy(eqx.Module):
    """The controller with Gaussian noise on every pose and velocity that it is told, each step.

    Standard deviations: `place` in metres (and, for velocities, in metres a second) and `angle` in
    radians (and radians a second). Target points and the forces that units sense stay exact. The
    noise follows from the episode's key.
    """

    controller: Controller
    place: float = 0.0
    angle: float = 0.0

    def __check_init__(self) -> None:
        observed = self.controller.card.observation
        if readings(observed)[1] > 1:
            raise InputError(f"{observed} is of several control steps: give a world with noise")

    @property
    def card(self) -> PolicyCard:
        """The controller's."""
        return self.controller.card

    def begin(self, state: State) -> Any:
        """What the controller remembers before the first step."""
        return begin(self.controller, self._seen(state))

    def plan(self, state: State, memory: Any) -> tuple[Float[Array, "unit act"], Any]:
        """What the controller does in the state as it is seen."""
        return act(self.controller, self._seen(state), memory)

    def act(self, state: State) -> Float[Array, "unit act"]:
        """The same, from the controller's first memory."""
        return self.plan(state, self.begin(state))[0]

    def _seen(self, state: State) -> State:
        keys = jr.split(jr.fold_in(state.key, state.time), 4)
        units, scales = state.chain.units, (self.place, self.angle, self.place, self.angle)
        true = units.position, units.angle, units.velocity, units.angular_velocity
        told = [
            x + scale * jr.normal(key, x.shape)
            for x, scale, key in zip(true, scales, keys, strict=True)
        ]
        chain = eqx.tree_at(lambda chain: chain.units, state.chain, Bodies(*told))
        obs = observe(self.card.observation, chain, state.target, state.force)
        return eqx.tree_at(lambda s: (s.chain, s.obs), state, (chain, obs))


class Delayed(eqx.Module):
    """The controller whose every action comes one control step (0.1 s) late; the first is none."""

    controller: Controller

    @property
    def card(self) -> PolicyCard:
        """The controller's."""
        return self.controller.card

    def begin(self, state: State) -> Any:
        """No thrust to come, and what the controller remembers."""
        memory = begin(self.controller, state)
        shapes = jax.eval_shape(lambda: act(self.controller, state, memory)[0])
        return jnp.zeros(shapes.shape, shapes.dtype), memory

    def plan(self, state: State, memory: Any) -> tuple[Float[Array, "unit act"], Any]:
        """The action of the step before; the present one is remembered."""
        due, inner = memory
        new, inner = act(self.controller, state, inner)
        return due, (new, inner)

    def act(self, state: State) -> Float[Array, "unit act"]:
        """The first action: none."""
        return self.begin(state)[0]


def changed(
    mass: float = 1.0, drag: float = 1.0, stiffness: float = 1.0, thrust: float = 1.0
) -> Physics:
    """The paper's physics with its constants multiplied: masses, drag, stiffness of the joints.

    A larger thrust limit is the same as smaller masses and weaker springs, so it is made of these.
    """
    plain = Physics()
    return Physics(
        unit_mass=plain.unit_mass * mass / thrust,
        link_mass=plain.link_mass * mass / thrust,
        drag=plain.drag * drag,
        joint_stiffness=plain.joint_stiffness * stiffness / thrust,
        angle_stiffness=plain.angle_stiffness * stiffness / thrust,
        contact_stiffness=plain.contact_stiffness / thrust,
    )
