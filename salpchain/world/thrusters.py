"""What a unit's thruster makes of the thrust that it is asked for: gain, failure, lag, one side."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from salpchain.physics.state import Scalar


class Thrusters(eqx.Module):
    """The thrusters of a chain during one episode."""

    gain: Float[Array, " unit"] | None = None  # of each unit; 0 is dead; None: all 1
    fails_at: Int[Array, " unit"] | None = None  # control step from which a thruster is dead
    lag: Scalar | None = None  # s, time constant of a first-order response; None: at once
    one_sided: bool | Bool[Array, ""] = False  # a jet that pushes along +heading only

    def working(self, time: Int[Array, ""], like: Float[Array, " unit"]) -> Float[Array, " unit"]:
        """The gain of each unit at a control step: 0 where dead."""
        gain = jnp.ones_like(like) if self.gain is None else self.gain
        return gain if self.fails_at is None else jnp.where(time < self.fails_at, gain, 0.0)

    def thrust(
        self,
        asked: Float[Array, " unit"],
        before: Float[Array, " unit"],
        time: Int[Array, ""],
        dt: Scalar,
    ) -> Float[Array, " unit"]:
        """Thrusts (N) of a control step of `dt` s, of those asked for and those of the step before.

        With a lag, exp(-dt / lag) of the difference to what was asked for is left after a step.
        """
        thrust = asked
        if self.one_sided is not False:
            thrust = jnp.where(self.one_sided, jnp.maximum(asked, 0.0), asked)
        thrust = thrust * self.working(time, asked)
        if self.lag is None:
            return thrust
        keep = jnp.exp(-dt / jnp.maximum(self.lag, 1e-6))
        return thrust + keep * (before - thrust)
