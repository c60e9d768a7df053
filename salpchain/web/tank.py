"""What is around the chains of the live page: a world drawn at each reset, and room in it."""

from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from salpchain.evaluation.suites import GRADES
from salpchain.evaluation.surroundings import Surroundings
from salpchain.evaluation.survey import surroundings
from salpchain.physics.state import Chain, at_rest
from salpchain.report.replay import packed_surroundings
from salpchain.tasks.config import FIXED_LIMIT, STEPS_PER_UNIT
from salpchain.web.swimmer import ANGLE, LINK, NEVER, Points, Swimmer
from salpchain.web.troubles import THRUSTERS, TROUBLES, poured
from salpchain.web.walls import Drawn, wall_gap
from salpchain.world.config import WorldConfig
from salpchain.world.current import Sum, Uniform
from salpchain.world.randomise import draw_world, with_obstacles
from salpchain.world.thrusters import Thrusters
from salpchain.world.world import World

MOST_UNITS = 128  # of all chains together (chosen)
SURVEY = 10  # control steps between two looks at the water (chosen)
ROOM = 0.04  # m, from a surface to the centre of a unit that is put there (chosen)
GRAIN = 0.01  # m, between the points of a way that is looked at (chosen)


class Tank:
    """The world of one reset: as the compiled step takes it, and as pages and edits see it."""

    def __init__(self, config: WorldConfig, seed: int) -> None:
        """Still water without obstacles, until it is filled."""
        self.config, self.world, self.around = config, World(), Surroundings()
        self._key = jr.key(seed)
        self.seed = np.zeros(2, np.uint32)  # of what changes in each control step
        self.troubles: frozenset[str] = frozenset()  # that were poured on it
        self.grade, self.is_rough = GRADES[1], False  # rough: whether anything ever was
        self.drawn, self.is_walled = Drawn(), False  # by hand; walled: whether anything ever was
        self._own = self.world.obstacles  # obstacles without walls drawn by hand
        self._surveyed = 0
        self._told = self.around, packed_surroundings(self.around, 0)

    def fill(self, one: Swimmer) -> Swimmer:
        """Draws a world with obstacles clear of a chain and its target; the chain with the
        thrusters that it has there."""
        self.drawn = Drawn()
        if self.config.is_still and not self.is_rough:
            self.world = self._walled(self.world)
            return one
        self._key, key, change_key = jr.split(self._key, 3)
        self.seed = np.asarray(jr.key_data(change_key))
        drawn = self._draw(key, one, self.troubles, self.grade if self.is_rough else "")
        self._own = drawn.obstacles
        self.world = self._walled(_without_thrusts(drawn))
        return _equipped(one, drawn.thrusters, 0)

    def build(self, drawn: Drawn) -> None:
        """Stands these walls in the water, and no others that were drawn by hand."""
        self.drawn, self.is_walled = drawn, True
        self.world = self._walled(self.world)

    def walled_world(self) -> World:
        """The world as it is where walls may be drawn, for a program to be compiled."""
        return replace(self.world, obstacles=Drawn().among(self._own))

    def _walled(self, world: World) -> World:
        own = self._own
        return replace(world, obstacles=self.drawn.among(own) if self.is_walled else own)

    def pour(
        self, swimmers: list[Swimmer], troubles: frozenset[str], grade: str, time: int
    ) -> list[Swimmer]:
        """Takes on these troubles, and no others, at once; obstacles stay where they are.

        Returns the chains, at this time (control steps): with other thrusters if the troubles are
        of thrusters, and with sensors that begin anew.
        """
        changed = (self.troubles ^ troubles) if grade == self.grade else self.troubles | troubles
        drawn = []
        for one in swimmers:
            self._key, key = jr.split(self._key)
            drawn.append(self._draw(key, one, troubles, grade))
        self.world = replace(_without_thrusts(drawn[0]), obstacles=self.world.obstacles)
        self.troubles, self.grade, self.is_rough = troubles, grade, True
        swimmers = [replace(one, memory=None) for one in swimmers]
        if not changed & THRUSTERS:
            return swimmers
        return [
            _equipped(one, world.thrusters, time)
            for one, world in zip(swimmers, drawn, strict=True)
        ]

    def rough_world(self, one: Swimmer) -> World:
        """A world as it is where any troubles were poured, for a program to be compiled."""
        drawn = self._draw(self._key, one, frozenset(), GRADES[1])
        return replace(_without_thrusts(drawn), obstacles=self.world.obstacles)

    def _draw(self, key: PRNGKeyArray, one: Swimmer, troubles: frozenset[str], grade: str) -> World:
        """A world for a chain; of no grade, one on which nothing was ever poured."""
        which = None
        if grade:
            at = 1 + GRADES.index(grade)
            which = {name: jnp.int32(at if name in troubles else 0) for name in TROUBLES}
        return _drawn(self.config, which, key, *map(jnp.asarray, _padded(one)))

    def survey(self, swimmers: list[Swimmer], current: np.ndarray, time: int | None = None) -> None:
        """Looks at the walls, and at the water around chains in a current (m/s) besides the drawn.

        If told the time (control steps), it looks once a second alone.
        """
        if time is not None and 0 <= time - self._surveyed < SURVEY:
            return
        self._surveyed = time or 0
        if self.world.current is None:
            water = np.asarray(current, np.float32).reshape(1, 1, 1, 2)
            still = replace(self.world, current=None)
            around = replace(surroundings(still, np.zeros((1, 2)), None, None), water=water)
        else:
            points = np.concatenate([p for one in swimmers for p in (one.units[:, :2], one.target)])
            flow = self.flow(jnp.asarray(current, jnp.float32))
            arrays = jax.tree.map(lambda x: x[None], eqx.filter(flow, eqx.is_array))
            moving = replace(self.world, current=flow)
            around = surroundings(moving, points, None, arrays)
        if not _same(around, self.around):
            self.around = around

    @property
    def told(self) -> dict[str, Any]:
        """What is around, as pages are told it; packed once as long as it is the same."""
        if self._told[0] is not self.around:
            self._told = self.around, packed_surroundings(self.around, 0)
        return self._told[1]

    def flow_on(self, arrays: Any) -> None:
        """Takes the drawn current as it is after a step: its arrays."""
        if self.world.current is not None:
            arrays = jax.tree.map(jnp.asarray, arrays)
            self.world = replace(self.world, current=eqx.combine(arrays, self.world.current))

    def flow(self, current: Float[Array, "2"]) -> Uniform | Sum:
        """The water's motion: the current (m/s) that a person set, and the drawn one."""
        own = Uniform(current)
        return own if self.world.current is None else Sum((own, self.world.current))

    @property
    def has_obstacles(self) -> bool:
        """Whether anything stands in the water."""
        return bool(len(self.around.walls) + len(self.around.posts))

    def gap(self, points: Points) -> Float[np.ndarray, " point"]:
        """How far points are from the nearest surface (m): below zero inside, infinite if none."""
        nearest = wall_gap(self.around.walls, points)
        for x, y, radius in self.around.posts.astype(float):
            nearest = np.minimum(nearest, np.hypot(*(points - [x, y]).T) - radius)
        return nearest

    def lets(self, begin: Points, end: Points) -> bool:
        """Whether units can go straight from these points to those, and stand there.

        A unit that lies at a surface may stay as near to it as it is.
        """
        if not self.has_obstacles:
            return True
        if (self.gap(end) < np.minimum(ROOM, self.gap(begin) - 1e-6)).any():
            return False
        return self.is_open(begin, end)

    def is_open(self, begin: Points, end: Points) -> bool:
        """Whether no surface lies across the straight ways between these points."""
        count = 2 + int(np.linalg.norm(end - begin, axis=1).max(initial=0.0) / GRAIN)
        ways = begin + np.linspace(0, 1, count)[:, None, None] * (end - begin)
        return bool((self.gap(ways.reshape(-1, 2)) > 0).all())

    def suits(self, target: Points, units: Points) -> bool:
        """Whether a target is clear of all surfaces, with none straight between it and a chain."""
        if not self.has_obstacles:
            return True
        begin, end = units.mean(axis=0, keepdims=True), target.mean(axis=0, keepdims=True)
        return bool((self.gap(target) > LINK).all()) and self.is_open(begin, end)


def _without_thrusts(world: World) -> World:
    """The world without what swimmers have of their own: gain and failure of each thruster."""
    if world.thrusters is None:
        return world
    return replace(world, thrusters=replace(world.thrusters, gain=None, fails_at=None))


def _equipped(one: Swimmer, made: Thrusters | None, time: int) -> Swimmer:
    """The chain with the thrusters that it has in a world that begins at a time."""
    if made is None:
        return one
    n = one.length
    gain = np.ones(n) if made.gain is None else np.asarray(made.gain[:n], float)
    fails_at = np.full(n, NEVER)
    if made.fails_at is not None:
        drawn = np.asarray(made.fails_at[:n])
        fails_at = np.where(drawn < NEVER, drawn + time, NEVER)
    return replace(one, gain=np.where(gain > 0, gain, 1.0), works=gain > 0, fails_at=fails_at)


def _same(one: Surroundings, other: Surroundings) -> bool:
    mine, others = one.named(), other.named()
    return all(np.array_equal(mine[name], others[name]) for name in mine)


def _padded(one: Swimmer) -> tuple[Points, Float[np.ndarray, " slot"], Points, int]:
    """Positions, angles and target of a chain in as many slots as there may be, and its length."""
    more = MOST_UNITS - one.length
    position, target = (
        np.pad(each, ((0, more), (0, 0))).astype(np.float32)
        for each in (one.units[:, :2], one.target)
    )
    return position, np.pad(one.units[:, ANGLE], (0, more)).astype(np.float32), target, one.length


@eqx.filter_jit
def _drawn(
    config: WorldConfig,
    which: dict[str, Array] | None,
    key: PRNGKeyArray,
    position: Array,
    angle: Array,
    target: Array,
    length: Array,
) -> World:
    """A world for a chain of so many units in the first slots, with troubles if any are given."""
    if which is not None:
        config = poured(config, which)
    present = jnp.arange(MOST_UNITS) < length
    chain: Chain = at_rest(position, angle, present)
    steps = jnp.maximum(FIXED_LIMIT, STEPS_PER_UNIT * length)
    world_key, obstacle_key = jr.split(key)
    world = draw_world(config, world_key, MOST_UNITS, length, steps)
    return with_obstacles(world, obstacle_key, chain, target)
