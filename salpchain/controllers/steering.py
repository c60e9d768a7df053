"""Controllers for chains that somebody else moves, such as a robot: poses in, actions out."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from salpchain.controllers import named
from salpchain.controllers.policy import Controller, Planner
from salpchain.errors import InputError
from salpchain.files import StrPath
from salpchain.given import told
from salpchain.physics.state import Bodies, at_rest
from salpchain.starting import check_can_compute
from salpchain.tasks.features import readings, senses
from salpchain.tasks.reach.task import SCLD

Poses = dict[str, np.ndarray]
VECTORS = ("position", "velocity", "target", "force")


class Steering:
    """What `steering` gives: call it with poses for actions, or ask for the thrusts."""

    def __init__(self, controller: Controller, env: SCLD) -> None:
        """For chains of the length and the actions of an environment."""
        self.controller, self.env = controller, env

    def __call__(
        self,
        position: Any,
        angle: Any,
        velocity: Any,
        angular_velocity: Any,
        target: Any,
        force: Any = None,
    ) -> np.ndarray:
        """The action of every unit for the next 0.1 s, (..., unit, act), each in [-1, 1].

        Of one chain, or of many with the same axes in front. Everything in one fixed frame of your
        choice; units in chain order.

        Args:
            position: (..., unit, 2) m.
            angle: (..., unit) rad, of a unit's axis along the chain, anticlockwise; it pushes along
                its heading, 90 degrees anticlockwise of that.
            velocity: (..., unit, 2) m/s.
            angular_velocity: (..., unit) rad/s.
            target: (..., unit, 2) m, one point for each unit.
            force: (..., unit, 2) N, of each unit's thrust in the last 0.1 s; zero without. The
                observation `table1` alone has it.

        Raises:
            InputError: an array of another shape, or one that is not finite, such as that of a
                lost marker: it says of which unit. Send no thrust then.
        """
        return self._played(position, angle, velocity, angular_velocity, target, force)[0]

    def thrust(
        self,
        position: Any,
        angle: Any,
        velocity: Any,
        angular_velocity: Any,
        target: Any,
        force: Any = None,
    ) -> np.ndarray:
        """The thrust of every unit for the next 0.1 s, (..., unit) N along its heading.

        Arguments and errors are those of a call.
        """
        return self._played(position, angle, velocity, angular_velocity, target, force)[1]

    def _played(self, *given: Any) -> tuple[np.ndarray, np.ndarray]:
        names = ("position", "angle", "velocity", "angular_velocity", "target", "force")
        check_can_compute()
        poses, axes = _checked(dict(zip(names, given, strict=True)), self.env.config.length)
        rows = {name: x.reshape(-1, *x.shape[len(axes) :]) for name, x in poses.items()}
        actions, thrusts = _play(self.controller, self.env, rows)
        actions, thrusts = np.asarray(actions), np.asarray(thrusts)
        return actions.reshape(*axes, *actions.shape[1:]), thrusts.reshape(*axes, -1)


def steering(controller: Controller | StrPath, length: int) -> Steering:
    """What maps poses from anywhere to actions: of a policy, of `Greedy`, `Approach`, or your own.

    `actions = steering(salpchain.load("any-length"), 8)(position, angle, velocity,
    angular_velocity, target)`, all as arrays; docs/python.md has a loop.

    Args:
        controller: a learned or a hand-written one, or its name or path.
        length: units of the chains.

    Raises:
        InputError: the controller cannot serve this length, or plans ahead on our own engine, as
            `MPC` does, which needs more than poses.
    """
    controller = named.controller(controller)
    if isinstance(controller, Planner):
        raise InputError(
            f"{controller.card.name} remembers, or plans on the simulation: it cannot be steered"
            " by poses; take a policy that remembers nothing, greedy or approach"
        )
    observation = controller.card.observation
    if readings(observation)[1] > 1:
        raise InputError(
            f"{controller.card.name} observes {observation}, several control steps at once: poses"
            " tell of one; take a policy that observes one"
        )
    needed = senses(observation)
    if needed:
        raise InputError(
            f"{controller.card.name} observes {controller.card.observation}, which senses"
            f" {', '.join(needed)}: poses do not tell it; take a policy that observes less"
        )
    return Steering(controller, SCLD(controller.card.task(length)))


def _checked(given: dict[str, Any], length: int) -> tuple[Poses, tuple[int, ...]]:
    """The poses as arrays of floats, and the axes that stand before those of a chain.

    Raises:
        InputError: one of another shape, no numbers, or not finite.
    """
    arrays = {name: as_floats(name, value) for name, value in given.items() if value is not None}
    missing = given.keys() - arrays.keys() - {"force"}
    if missing:
        raise InputError(f"{sorted(missing)[0]} must be an array of numbers, got None")
    axes = arrays["position"].shape[:-2]
    if 0 in axes:
        raise InputError(f"give one chain or more, got position of shape {(*axes, length, 2)}")
    arrays.setdefault("force", np.zeros((*axes, length, 2)))
    poses: Poses = {}
    for name, array in arrays.items():
        shape = (*axes, length, 2) if name in VECTORS else (*axes, length)
        if array.shape != shape:
            like = f" as that of position, {arrays['position'].shape}" if axes else ""
            raise InputError(
                f"{name} must have shape {_shape(name, length)}{like}, got {array.shape}"
            )
        if not np.isfinite(array).all():
            unit = int(np.argwhere(~np.isfinite(array))[0][len(axes)])
            raise InputError(f"{name} of unit {unit} is not finite: send no thrust")
        poses[name] = array
    return poses, axes


def as_floats(name: str, value: Any) -> np.ndarray:
    """The value as a NumPy array of floats.

    Raises:
        InputError: no numbers, or a traced array: what steers what others move runs outside
            compiled code.
    """
    if isinstance(value, Tracer):
        raise InputError(
            f"steering maps NumPy arrays, outside jax.jit, vmap and grad, but {name} is traced: use"
            " env.step and policy.act there"
        )
    try:
        return np.asarray(value, float)
    except (TypeError, ValueError):
        raise InputError(f"{name} must be an array of numbers, got {told(value)}") from None


def _shape(name: str, length: int) -> str:
    return f"(..., {length}, 2)" if name in VECTORS else f"(..., {length})"


@eqx.filter_jit
def _play(controller: Controller, env: SCLD, rows: dict[str, Any]) -> tuple[Array, Array]:
    """Actions and thrusts for a batch of chains."""

    def one(poses: dict[str, Float[Array, "..."]]) -> tuple[Array, Array]:
        chain = at_rest(poses["position"], poses["angle"])
        units = Bodies(
            poses["position"], poses["angle"], poses["velocity"], poses["angular_velocity"]
        )
        chain = eqx.tree_at(lambda c: c.units, chain, units)
        state = env.start(chain, poses["target"], jr.key(0))
        seen = env.observe(chain, poses["target"], poses["force"])
        state = eqx.tree_at(lambda s: (s.obs, s.force), state, (seen, poses["force"]))
        actions = jnp.clip(controller.act(state), -1.0, 1.0)
        return actions, env.thrust(chain, actions)

    return jax.vmap(one)({name: jnp.asarray(x, jnp.float32) for name, x in rows.items()})
