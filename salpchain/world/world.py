"""The world that a chain swims in: its dynamics, the water, its thrusters, obstacles, sensors."""

from typing import Any

import equinox as eqx
from jaxtyping import Array, Float, Int, PRNGKeyArray

from salpchain.dynamics.robot import Dynamics
from salpchain.errors import InputError
from salpchain.given import instance, is_scalar, told
from salpchain.physics.chain import step
from salpchain.physics.obstacles import Obstacles
from salpchain.physics.state import Chain, Physics, Scalar
from salpchain.world.config import WorldConfig
from salpchain.world.current import Current, carried
from salpchain.world.sensing import Sensing
from salpchain.world.thrusters import Thrusters


class World(eqx.Module):
    """All that acts on a chain but its controller. A field that is None costs nothing.

    Arrays among the fields belong to one episode, and travel in its state; all else is the same
    for all episodes and fixed when a program is compiled.

    Raises:
        InputError: a part of another kind.
    """

    dynamics: Physics = eqx.field(default_factory=Physics)
    current: Current | None = None
    thrusters: Thrusters | None = None
    obstacles: Obstacles | None = None
    sensing: Sensing | None = None
    drawn_from: WorldConfig | None = eqx.field(default=None, static=True)  # for each episode
    ease: Scalar | None = None  # share of what it is drawn from that episodes are spared besides

    def __check_init__(self) -> None:
        instance("World.dynamics", self.dynamics, Physics, "a Physics")
        for name, kind in _PARTS.items():
            part = getattr(self, name)
            if part is not None:
                instance(f"World.{name}", part, kind, f"a {kind.__name__}, or None")
        if self.ease is not None and not is_scalar(self.ease):
            raise InputError(f"World.ease must be a number, or None, got {told(self.ease)}")
        if self.obstacles is not None and isinstance(self.dynamics, Dynamics):
            raise InputError("walls and posts push the paper's chains only: leave obstacles out")

    def thrust(
        self, asked: Float[Array, " unit"], before: Float[Array, " unit"], time: Int[Array, ""]
    ) -> Float[Array, " unit"]:
        """The thrusts (N) that the thrusters make of those asked for."""
        if self.thrusters is None:
            return asked
        return self.thrusters.thrust(asked, before, time, self.dynamics.control_step)

    def step(
        self,
        chain: Chain,
        thrust: Float[Array, " unit"],
        fence: Any = None,
        contact: bool = True,
    ) -> Chain:
        """The chain one control step later, under the thrusts (N) that act.

        Raises:
            InputError: a fence, where other dynamics than the paper's move the chain.
        """
        if isinstance(self.dynamics, Dynamics):
            if fence is not None:
                raise InputError("the fence holds the paper's chains only: set task.fence=false")
            return self.dynamics.advance(chain, thrust, self.current)
        if self.current is not None:
            chain = carried(chain, self.current, self.dynamics)
        return step(chain, thrust, self.dynamics, fence, contact, self.obstacles)

    def ready(self, chain: Chain) -> Chain:
        """The chain with what the dynamics remember of it, before its first step.

        Raises:
            InputError: links that part and join, where other dynamics than the paper's move it.
        """
        if not isinstance(self.dynamics, Dynamics):
            return chain
        if chain.docking is not None:
            raise InputError(
                "only the paper's chains part and join: leave world.dynamics out, or give task"
                " reach or follow and task.action=thrust"
            )
        return self.dynamics.ready(chain)

    def advance(self, key: PRNGKeyArray) -> "World":
        """The world one control step later: with the current that it has then."""
        if self.current is None:
            return self
        current = self.current.advance(key, self.dynamics.control_step)
        return eqx.tree_at(lambda w: w.current, self, current)


_PARTS = {
    "current": Current,
    "thrusters": Thrusters,
    "obstacles": Obstacles,
    "sensing": Sensing,
    "drawn_from": WorldConfig,
}


def of_episode(world: World) -> World:
    """The arrays of a world: what may differ from episode to episode."""
    return eqx.filter(world, eqx.is_array)
