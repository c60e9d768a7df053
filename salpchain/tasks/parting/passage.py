"""`passage`: a wall across the way, with an opening; the target pose is behind it."""

from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
from jaxtyping import Array, Float, PRNGKeyArray

from salpchain.errors import InputError
from salpchain.physics.obstacles import Obstacles, Posts, Walls
from salpchain.physics.state import Chain, Physics, at_rest
from salpchain.switches import standard_promotion
from salpchain.tasks.checks import checked_clear
from salpchain.tasks.parting.config import CLEAR, FARTHEST, THICK, TUNNEL, TURN, PassageConfig
from salpchain.tasks.parting.course import Course, Parting, gentle_pose
from salpchain.tasks.state import Start, State
from salpchain.world.world import World

REACH = 6.0  # chain lengths that a wall goes on to either side (chosen): longer than any way round


class Plan(NamedTuple):
    """Where the walls of a passage stand."""

    walls: Walls
    lanes: Float[Array, "lane point 2"]  # m
    depth: Array  # m, of all walls, along the way
    width: Array  # m, of an opening

    @property
    def course(self) -> Course:
        """What a planner may know of it."""
        return Course(self.lanes, jnp.asarray(self.width, float), jnp.int32(0))


class Passage(Parting):
    """The wall is the y axis; the chain starts left of it in any direction, the pose is right.

    The world is the walls of the passage, and those of `config.walls`.
    """

    config: PassageConfig = eqx.field(default_factory=PassageConfig, static=True)

    def __check_init__(self) -> None:
        drawn = self.world.drawn_from
        if self.world.obstacles is not None or (drawn is not None and _has_obstacles(drawn)):
            raise InputError(
                "passage has walls of its own, others could stand across its start or its target:"
                " take a world without obstacles"
            )

    def begin(
        self, key: PRNGKeyArray, draw_key: PRNGKeyArray, length: int | Array, physics: Physics
    ) -> Start:
        """A straight chain before the wall, its pose behind it, each at least a length away."""
        del key
        chance = jr.uniform(draw_key, (10,))
        slots, link = self.config.length, physics.link_length
        extent, plan = length * link, self._plan(length, link)
        far = extent * (1 + (FARTHEST - 1) * chance[:2]) + plan.depth / 2 + CLEAR
        aside = extent * (chance[2:4] - 0.5)
        ways = plan.lanes[:, :, 1].mean(axis=0)
        angle = 2 * jnp.pi * chance[4]
        along = jnp.stack([jnp.cos(angle), jnp.sin(angle)])
        slot = jnp.arange(slots)
        present = slot < length
        start = jnp.stack([-far[0], ways[0] + aside[0]])
        place = start + (slot - (length - 1) / 2)[:, None] * link * along
        chain = at_rest(place, jnp.full(slots, angle), present, present[1:])
        goal = jnp.stack([far[1], ways[-1] + aside[1]])
        pose = gentle_pose(chance[5:], goal, slots, length, link)
        return Start(self.prepared(chain), pose, plan.course)

    def _plan(self, length: int | Array, link: Array | float) -> Plan:
        """The walls for a chain of this length."""
        extent = jnp.asarray(length * link, float)
        plan = passage(self.config.way, self.config.free * extent, extent)
        more = jnp.asarray(self.config.walls, float).reshape(-1, 2, 2)
        width, there = jnp.full(len(more), THICK), jnp.ones(len(more), bool)
        both = jax.tree.map(lambda *x: jnp.concatenate(x), plan.walls, Walls(more, width, there))
        return plan._replace(walls=both)

    def _start(
        self, chain: Chain, target: Array, key: PRNGKeyArray, world: World, plan: Any
    ) -> State:
        there = self._plan(chain.present.sum(), world.dynamics.link_length)
        plan = there.course if plan is None else plan
        around = Obstacles(there.walls, Posts(jnp.zeros((0, 2)), jnp.zeros(0), jnp.zeros(0, bool)))
        if world.drawn_from is not None:
            world = replace(world, drawn_from=None)
        return super()._start(chain, target, key, replace(world, obstacles=around), plan)

    @standard_promotion
    def start(self, chain: Chain, target: Float[Array, "unit 2"], key: PRNGKeyArray) -> State:
        """As `Task.start`, clear of the passage's walls.

        Raises:
            InputError: as `Task.start`; outside `jax.jit`, a wall in the way of the chain or of the
                target.
        """
        state = super().start(chain, target, key)
        world = self.world_of(state)
        there = eqx.tree_at(
            lambda s: (s.chain.units.position, s.chain.linked),
            state,
            (state.target, jnp.zeros_like(state.chain.linked)),
        )
        checked_clear(state, world)
        try:
            checked_clear(there, world)
        except InputError:
            raise InputError("a wall covers the target: move one of them") from None
        return state

    def world_of(self, state: State) -> World:
        """The world of this episode, with its walls."""
        rest = eqx.combine(replace(state.world, obstacles=None), self.world)
        return replace(rest, obstacles=state.world.obstacles)


def _has_obstacles(config: object) -> bool:
    of = config.obstacles  # type: ignore[attr-defined]
    return any(bool(getattr(of, name).high) for name in ("posts", "walls", "room"))


def passage(way: str, width: Array, extent: Array) -> Plan:
    """The walls of a passage whose openings have this width (m), for a chain of this length (m)."""
    depth = {"tunnel": jnp.asarray(TUNNEL), "blocks": extent}.get(way, jnp.asarray(THICK))
    end, none = REACH * extent, jnp.zeros(())
    if way == "two":
        middle = width / 2 + extent / 4
        ends = [_wall(none, *at) for at in (
            (-end, -middle - width / 2), (-middle + width / 2, middle - width / 2),
            (middle + width / 2, end),
        )]  # fmt: skip
        lanes = jnp.stack([_lane(depth, -middle), _lane(depth, middle)])
    elif way == "winding":
        apart, aside = width + TURN, width + TURN / 2
        left, right = -(apart + depth) / 2, (apart + depth) / 2
        ends = [
            _wall(left, -end, -width / 2), _wall(left, width / 2, end),
            _wall(right, -end, aside - width / 2), _wall(right, aside + width / 2, end),
        ]  # fmt: skip
        points = [(left - depth / 2, none), (none, none), (none, aside), (right + depth / 2, aside)]
        lanes = jnp.stack([jnp.stack(point) for point in points])[None]
        solid = Walls(jnp.stack(ends), jnp.full(4, depth), jnp.ones(4, bool))
        return Plan(solid, lanes, apart + 2 * depth, width)
    else:
        low, high = (-3 * width, 2.5 * width) if way == "blocks" else (-end, end)
        ends = [_wall(none, low - width / 2, -width / 2), _wall(none, width / 2, high)]
        lanes = _lane(depth, none)[None]
    solid = Walls(jnp.stack(ends), jnp.full(len(ends), depth), jnp.ones(len(ends), bool))
    return Plan(solid, lanes, depth, width)


def _wall(x: Array, low: Array, high: Array) -> Float[Array, "2 2"]:
    """The ends of the middle line of a wall along y."""
    return jnp.stack([jnp.stack([x, low]), jnp.stack([x, high])])


def _lane(depth: Array, y: Array) -> Float[Array, "2 2"]:
    """The way through an opening at this y."""
    return jnp.stack([jnp.stack([-depth / 2, y]), jnp.stack([depth / 2, y])])
