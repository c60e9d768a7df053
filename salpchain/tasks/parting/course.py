"""What `dock`, `passage` and `gather` share: links that are cut and closed, and the verdict."""

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from salpchain.physics.docking import dockable, shut
from salpchain.physics.state import Chain, Latch, at_rest
from salpchain.tasks.parting.config import PATIENCE, PartingConfig
from salpchain.tasks.reach.reward import reached, reward_terms
from salpchain.tasks.reach.targets import Bend, curve
from salpchain.tasks.reach.task import SCLD
from salpchain.tasks.state import Judgement, Moment, State
from salpchain.world.world import World

GENTLE = (0.7, 2.7)  # chain lengths, radius of the arcs of a target pose (chosen)


class Course(eqx.Module):
    """What a planner may know of the way, and for how long the chain has held its pose."""

    lanes: Float[Array, "lane point 2"]  # m, ways through walls: a point before each, one behind
    width: Float[Array, ""]  # m, of an opening; infinite without walls
    held: Int[Array, ""]  # control steps in which the chain has been one, in its pose, in a row


def open_water() -> Course:
    """The way where there are no walls."""
    return Course(jnp.zeros((0, 2, 2)), jnp.asarray(jnp.inf), jnp.int32(0))


class Parting(SCLD):
    """The target pose of `reach`, which counts as taken by units that are joined as one chain.

    Units hold what they have, and take hold where they can, unless the action is `grip`, by which
    they can let go.
    """

    config: PartingConfig = eqx.field(default_factory=PartingConfig, static=True)

    def prepared(self, chain: Chain) -> Chain:
        """The chain with links that can be cut, and a record of what obstacles do to it."""
        chain = dockable(chain, Latch(distance=self.config.capture), record=True)
        nothing = jnp.zeros_like(chain.units.angle[0])
        return eqx.tree_at(lambda c: c.impulse, chain, nothing, is_leaf=lambda x: x is None)

    def _start(
        self, chain: Chain, target: Array, key: PRNGKeyArray, world: World, plan: Any
    ) -> State:
        chain = chain if chain.impulse is not None else self.prepared(chain)
        course = open_water() if plan is None else plan
        return super()._start(chain, target, key, world, course)

    def step_limit(self, length: int | Array) -> Int[Array, ""] | int:
        """Control steps until truncation; traceable twin of `config.step_limit`."""
        return self.config.most_steps or PATIENCE * super().step_limit(length)

    def move(self, state: State) -> tuple[Float[Array, "unit 2"], Any]:
        """The target stays; what is remembered is how long the pose has been held."""
        held = jnp.where(self._is_whole_in(state.chain, state.target), state.plan.held + 1, 0)
        return state.target, eqx.tree_at(lambda c: c.held, state.plan, held)

    @property
    def target_stands(self) -> bool:
        """It does."""
        return True

    def judge(self, before: State, after: Moment) -> Judgement:
        """The terms of `reach`; the episode ends once the pose is taken and held by one chain."""
        now = self._is_whole_in(after.chain, after.target) & after.valid
        wanted = round(self.config.hold / CONTROL_STEP)
        goal = now & (before.plan.held + 1 >= wanted)
        return Judgement(reward_terms(before.distances, after.distances, goal), goal)

    def _is_whole_in(self, chain: Chain, target: Array) -> Bool[Array, ""]:
        """Whether the units are one chain in this pose."""
        return is_whole(chain) & reached(chain, target, self.config.tolerance)

    def gauge(self, state: State) -> dict[str, Float[Array, ""]]:
        """Links that are closed; how far off they were when they last closed; pushes of walls."""
        chain, docking = state.chain, state.chain.docking
        if docking is None or docking.caught is None or docking.catches is None:
            raise ValueError("the chain of this task must be one that `prepared` gave")
        num = jnp.maximum((docking.catches > 0).sum(), 1)
        gap, angle, speed = (
            jnp.where(docking.catches > 0, docking.caught[:, k], 0.0).sum() / num for k in range(3)
        )
        lost = (chain.held & ~shut(chain)).sum().astype(gap.dtype)
        catches = docking.catches.sum().astype(gap.dtype)
        parts = {"parted": lost, "catches": catches, "gap": gap, "angle": angle, "speed": speed}
        impulse = jnp.zeros_like(gap) if chain.impulse is None else chain.impulse
        return parts | {"impulse": impulse, "distance": state.distances.mean}

    def measure(self, series: Mapping[str, np.ndarray]) -> dict[str, float]:
        """Docks made and held, how exact they were, and what the walls did.

        `docking_distance` (m), `docking_angle` (rad), `docking_speed` (m/s): mean over the links
        that closed, of the last time each did; `joined_time`: s until the units were one chain
        for good; `wall_contacts`; `wall_impulse`: N s, the largest of one contact.
        """
        docks, parted = series["catches"], np.asarray(series["parted"])
        made, apart = float(docks[-1]), np.flatnonzero(parted > 0)
        since = apart[-1] + 1 if len(apart) else 0
        touches = _runs(np.asarray(series["impulse"], float))
        ends = {f"docking_{k}": v for k, v in
                (("distance", "gap"), ("angle", "angle"), ("speed", "speed"))}  # fmt: skip
        return {
            "docks": made,
            "joined": float(parted[-1] == 0),
            "joined_time": since * CONTROL_STEP if parted[-1] == 0 else np.nan,
            "parted_links": float(parted[-1]),
            **{name: float(series[key][-1]) if made else np.nan for name, key in ends.items()},
            "wall_contacts": float(len(touches)),
            "wall_impulse": max(touches, default=0.0),
        }


CONTROL_STEP = 0.1  # s, of the paper's physics: worlds of tasks have no other


def _runs(values: np.ndarray) -> list[float]:
    """The sums of the stretches of an array that are above 0."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], values > 0, [0]])))
    return [float(values[a:b].sum()) for a, b in edges.reshape(-1, 2)]


def is_whole(chain: Chain) -> Bool[Array, ""]:
    """Whether all present units are joined, every joint shut."""
    return (shut(chain) | ~chain.held).all()


def gentle_pose(
    chance: Float[Array, "5"], centre: Array, slots: int, length: int | Array, link: Any
) -> Float[Array, "slots 2"]:
    """A target pose (m) of one or two wide arcs about its centroid, from numbers in [0, 1)."""
    extent, slot = length * link, jnp.arange(slots)[:, None]
    radius = extent * (GENTLE[0] + (GENTLE[1] - GENTLE[0]) * chance[0])
    bend = Bend(radius, jnp.where(chance[1] < 0.5, -1.0, 1.0), jnp.where(chance[2] < 0.5, 1.0, 0.0))
    points = curve(bend, 2 * jnp.pi * chance[3], slots, length, link)
    middle = jnp.where(slot < length, points, 0.0).sum(axis=0) / length
    return points - middle + centre


def straight(
    centre: Float[Array, "unit 2"],
    angle: Float[Array, " unit"],
    offset: Float[Array, " unit"],
    length: int | Array,
    linked: Bool[Array, " link"],
) -> Chain:
    """Straight pieces at rest: each unit so far (m) along the axis of its piece from its centre."""
    along = jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=-1)
    present = jnp.arange(len(angle)) < length
    chain = at_rest(centre + offset[:, None] * along, angle, present, linked & present[1:])
    half = jnp.linalg.norm(chain.units.position[1] - chain.units.position[0])
    return _hanging(chain, half)


def _hanging(chain: Chain, link: Array) -> Chain:
    """The chain with every link in line with its first unit, as far on as a joined one."""
    angle = chain.units.angle[:-1]
    along = jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=-1)
    links = eqx.tree_at(
        lambda b: (b.position, b.angle), chain.links,
        (chain.units.position[:-1] + link / 2 * along, angle),
    )  # fmt: skip
    rest = jnp.zeros_like(chain.rest_angle)
    return eqx.tree_at(lambda c: (c.links, c.rest_angle), chain, (links, rest))
