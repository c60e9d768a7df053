"""The live world: the chains that swim in it, and everything that a person may do to them."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from salpchain.checks import check_length
from salpchain.controllers.policy import Controller, PolicyCard
from salpchain.errors import InputError
from salpchain.web import apart, swimmer
from salpchain.web.drawing import nearer_way_round, random_target, resampled
from salpchain.web.pool import CHAINS, Moved, Packed, Pool, empty, slots_for
from salpchain.web.swimmer import Swimmer
from salpchain.web.tank import MOST_UNITS, Tank
from salpchain.web.troubles import check_troubles
from salpchain.web.walls import Drawn
from salpchain.world.config import WorldConfig

FASTEST_CURRENT = 0.3  # m/s (chosen: half as fast again as a chain)
HARDEST_KICK = 3.0  # m/s, of the one unit that is pushed (chosen)
KICKS_AMONG_WALLS = 1.0  # m/s, of all units in a step, so that none goes through one (chosen)
TRIES = 64  # random targets that are drawn before one stands in a wall (chosen)
FIRST_LENGTH = 12  # units, until somebody changes it (chosen)

Point = Float[np.ndarray, "2"]


@dataclass
class World:
    """Chains in a tank; edits take effect at once, time passes with `advance`.

    Each reset draws what is in the tank anew from the settings of a world.

    Every edit raises InputError, and changes nothing, where it cannot be done.
    """

    seed: int = 0
    time: int = 0  # control steps
    current: Point = field(default_factory=lambda: np.zeros(2))  # m/s
    swimmers: list[Swimmer] = field(default_factory=list)
    card: PolicyCard | None = None  # of the controller that steers
    epoch: int = 0  # counts resets, so that a page knows that chains did not swim but jump
    config: WorldConfig = field(default_factory=WorldConfig)

    def __post_init__(self) -> None:
        self._dice = np.random.default_rng(self.seed)
        self._names, self.tank = 0, Tank(self.config, self.seed)
        self._kicks: list[tuple[int, int, Point]] = []
        if not self.swimmers:
            self.reset(FIRST_LENGTH)

    def reset(self, length: int | None = None) -> None:
        """One straight chain, as long as all were together, and a new random target."""
        length = self.num_units if length is None else length
        self._check_room(check_length(length))
        self._check_serves([length])
        target = random_target(self._dice, length, np.zeros(2))
        angle = self._dice.uniform(0, 2 * np.pi)
        one = swimmer.straight(self._new_name(), length, np.zeros(2), angle, target)
        one = swimmer.aimed(one, nearer_way_round(target, one.units[:, :2]))
        self.swimmers, self._kicks, self.time = [self.tank.fill(one)], [], 0
        self.epoch += 1
        self.tank.survey(self.swimmers, self.current)

    @property
    def num_units(self) -> int:
        """The number of units of all chains together."""
        return sum(one.length for one in self.swimmers)

    def place(self, name: int, x: float, y: float, turn: float) -> None:
        """Moves a chain's target pose to a centre (m) and turns it to an angle (rad)."""
        self._change(name, lambda one: swimmer.placed(one, np.array([x, y]), turn))

    def draw(self, name: int, points: Sequence[tuple[float, float]]) -> None:
        """Gives a chain a target along a line drawn by hand (m)."""

        def aim(one: Swimmer) -> Swimmer:
            target = resampled(np.array(points), one.length)
            return swimmer.aimed(one, nearer_way_round(target, one.units[:, :2]))

        self._change(name, aim)

    def retarget(self, name: int) -> None:
        """Gives a chain a new random target near it, clear of obstacles where that can be."""

        def aim(one: Swimmer) -> Swimmer:
            units = one.units[:, :2]
            for _ in range(TRIES):
                target = random_target(self._dice, one.length, units.mean(axis=0))
                if self.tank.suits(target, units):
                    break
            return swimmer.aimed(one, nearer_way_round(target, units))

        self._change(name, aim)

    def grow(self, name: int) -> None:
        """Adds a unit at a chain's end."""
        one = self._find_whole(name)
        self._check_room(self.num_units + 1)
        self._check_serves([one.length + 1])
        others = [other.units[:, :2] for other in self.swimmers if other.name != name]
        taken, lets = np.vstack([np.empty((0, 2)), *others]), self.tank.lets
        self._change(name, lambda _: swimmer.grown(one, taken, lets))

    def shrink(self, name: int) -> None:
        """Takes the unit at a chain's end away."""
        smaller = swimmer.shrunk(self._find_whole(name))
        self._check_serves([smaller.length])
        self._change(name, lambda _: smaller)

    def switch(self, name: int, unit: int, on: bool) -> None:
        """Turns a unit's thruster on or off."""
        works = self._find(name, unit).works.copy()
        works[unit] = on
        self._change(name, lambda one: replace(one, works=works))

    def cut(self, name: int, link: int) -> None:
        """Makes two chains of one, each with its own target."""
        if len(self.swimmers) >= CHAINS:
            raise InputError(f"{CHAINS} chains swim already: join two of them first")
        whole, index = self._find_whole(name), self.swimmers.index(self._find(name))
        parts = swimmer.cut(whole, link, self._names + 1)
        self._check_serves([part.length for part in parts])
        self._names += 1
        self.swimmers[index : index + 1] = parts

    def join(self, name: int, other: int) -> None:
        """Links two chains at their nearest ends."""
        if name == other:
            raise InputError("a chain cannot be joined to itself: give two chains")
        whole = swimmer.joined(self._find_whole(name), self._find_whole(other), self.tank.lets)
        self._check_serves([whole.length])
        self.swimmers = [one for one in self.swimmers if one.name != other]
        self._change(name, lambda _: whole)

    def push(self, name: int, unit: int, x: float, y: float) -> None:
        """Gives a unit a kick (m/s) at the next step."""
        self._find(name, unit)
        kick = np.array([x, y])
        self._kicks.append((name, unit, kick * min(1, HARDEST_KICK / max(np.hypot(x, y), 1e-9))))
        del self._kicks[:-MOST_UNITS]

    def flow(self, x: float, y: float) -> None:
        """Sets a current of the water (m/s), besides the world's own."""
        speed = float(np.hypot(x, y))
        if speed > FASTEST_CURRENT:
            raise InputError(f"a current is at most {FASTEST_CURRENT} m/s, got {speed:.2f}")
        self.current = np.array([x, y])
        self.tank.survey(self.swimmers, self.current)

    def pour(self, troubles: Iterable[str], grade: str) -> None:
        """Puts the chains in these troubles at a grade, and in no others, as they swim."""
        meant = check_troubles(troubles, grade)
        self.swimmers = self.tank.pour(self.swimmers, meant, grade, self.time)
        self.tank.survey(self.swimmers, self.current)

    def build(
        self, begin: tuple[float, float], end: tuple[float, float], opening: float = 0.0
    ) -> None:
        """Stands a wall between two points (m), clear of all units, with an opening (m) if any."""
        units = np.concatenate([one.units[:, :2] for one in self.swimmers])
        self.tank.build(self.tank.drawn.with_wall(begin, end, opening, units))
        self.tank.survey(self.swimmers, self.current)

    def clear(self, point: tuple[float, float] | None = None) -> None:
        """Takes away the wall drawn nearest to a point (m), or all that were drawn."""
        left = self.tank.drawn.without(np.array(point)) if point is not None else Drawn()
        self.tank.build(left)
        self.tank.survey(self.swimmers, self.current)

    def steer_by(self, card: PolicyCard) -> None:
        """From now on a controller with this card steers; it must serve all chains there are."""
        self._check_serves([one.length for one in self.swimmers], card)
        for one in self.swimmers:
            self._find_whole(one.name)
        self.card = card

    def advance(self, pool: Pool, controller: Controller) -> None:
        """One control step (0.1 s) of all chains."""
        self._set_out(controller)
        if all(one.trip is None for one in self.swimmers):
            controller = apart.below(controller)
        packed = self._pack(controller.card.observation)
        moved = pool.advance(controller, packed, self.tank.world)
        if not (np.isfinite(moved.units).all() and np.isfinite(moved.links).all()):
            self.reset()  # no edit is known to do this; a world must never stay broken
            return
        self.time += 1
        self._kicks = []
        self.tank.flow_on(moved.water)
        self.swimmers = [
            _after(one, moved, index, int(first), self.time)
            for index, (one, first) in enumerate(zip(self.swimmers, packed.first, strict=False))
        ]
        self.tank.survey(self.swimmers, self.current, self.time)

    def _set_out(self, controller: Controller) -> None:
        """Ends the trip of a chain that is whole and has arrived or has another target; begins one
        where a planner steers the only chain and its way goes through an opening."""
        plans = apart.is_planner(controller)
        for one in self.swimmers:
            trip = one.trip
            if trip is None or one.is_apart:
                continue
            moved = not np.array_equal(trip.target[: one.length], one.target.astype(np.float32))
            if trip.there or moved or not plans:
                self._change(one.name, lambda one: replace(one, trip=None))
        one, gate = self.swimmers[0], self.tank.drawn.gate
        alone = len(self.swimmers) == 1 and one.trip is None and one.since >= apart.SETTLED
        if not (plans and gate and alone):
            return
        lane = gate.lane(one.units[:, :2].mean(axis=0), one.target.mean(axis=0))
        if lane is not None:
            slots, way = slots_for(one.length), (one.rest, one.target, lane, gate.opening)
            self.swimmers = [replace(one, trip=apart.set_out(controller, slots, *way))]

    def _pack(self, observation: str) -> Packed:
        """All chains one after the other; the gap between two chains is no link."""
        packed = empty(slots_for(self.num_units), self.tank.world, observation)
        first = 0
        for index, one in enumerate(self.swimmers):
            units, links = slice(first, first + one.length), slice(first, first + one.length - 1)
            packed.units[units], packed.links[links] = one.units, one.links
            packed.rest[links], packed.linked[links] = one.rest, True
            packed.target[units], packed.gain[units] = one.target, one.gain * one.works
            packed.thrust[units] = one.pushes
            if one.memory is not None:
                packed.memory[units], packed.begins[units] = one.memory, False
            if one.seen is not None and one.seen.shape[1] == packed.seen.shape[1]:
                packed.seen[units], packed.starts[units] = one.seen, False
            packed.first[index], packed.count[index] = first, one.length
            if one.trip is not None:
                packed = packed._replace(trip=one.trip, linked=one.trip.linked)
            for name, unit, kick in self._kicks:
                if name == one.name and unit < one.length:
                    packed.kick[first + unit] += kick
            first += one.length
        if self.tank.has_obstacles:
            speed = np.linalg.norm(packed.kick, axis=1).sum()
            packed.kick[:] *= min(1.0, KICKS_AMONG_WALLS / max(speed, 1e-9))
        packed.current[:], packed.time[()] = self.current, self.time
        packed.seed[:] = self.tank.seed
        return packed

    def _find(self, name: int, unit: int = 0) -> Swimmer:
        """The chain of this name, which has such a unit."""
        for one in self.swimmers:
            if one.name == name:
                if not 0 <= unit < one.length:
                    raise InputError(f"chain {name} has units 0 to {one.length - 1}, got {unit}")
                return one
        raise InputError(f"there is no chain {name} (any more)")

    def _find_whole(self, name: int) -> Swimmer:
        """The chain of this name, which has not taken itself apart, off its trip."""
        one = self._find(name)
        if one.is_apart:
            raise InputError("the chain is apart: wait until it has joined again, or reset")
        return replace(one, trip=None)

    def _change(self, name: int, change: Callable[[Swimmer], Swimmer]) -> None:
        index = self.swimmers.index(self._find(name))
        self.swimmers[index] = change(self.swimmers[index])

    def _new_name(self) -> int:
        self._names += 1
        return self._names

    def _check_room(self, units: int) -> None:
        if units > MOST_UNITS:
            raise InputError(f"the live page holds at most {MOST_UNITS} units, got {units}")

    def _check_serves(self, lengths: Sequence[int], card: PolicyCard | None = None) -> None:
        if card := card or self.card:
            for length in lengths:
                card.check_serves(length)


def _after(one: Swimmer, moved: Moved, index: int, first: int, time: int) -> Swimmer:
    """The chain after a step, which is the one of this index and begins in this slot."""
    n, since, good = one.length, one.since + 1, bool(moved.reached[index])
    mine = slice(first, first + n)
    fails, trip = one.works & (one.fails_at == time), moved.trip
    return replace(
        one,
        units=moved.units[mine].astype(float),
        links=moved.links[first : first + n - 1].astype(float),
        rest=one.rest if trip is None else trip.rest[: n - 1].astype(float),
        trip=trip,
        works=one.works & ~fails if fails.any() else one.works,
        thrust=moved.thrust[mine].astype(float),
        memory=moved.memory[mine] if moved.memory.shape[1] else None,
        seen=moved.seen[mine] if moved.seen.shape[1] else None,
        distance=float(moved.distance[index]),
        reached=good,
        since=since,
        arrived=since if good and one.arrived is None else one.arrived,
    )
