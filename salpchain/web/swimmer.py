"""One chain of the live world as plain arrays, and what can be done to it: grow, cut, join."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from salpchain.checks import SHORTEST
from salpchain.errors import InputError
from salpchain.tasks.reach.targets import LINK

X, Y, ANGLE, VX, VY, SPIN = range(6)  # columns of bodies
REACH = 0.3  # m, how near two ends must be to be joined (chosen)
ROOM = 0.055  # m, how far a new unit must be from all others (chosen: a unit's width and a bit)
LEANS = np.radians([0, 20, -20, 40, -40, 60, -60, 80, -80])  # tried for a new unit, in this order

Bodies = Float[np.ndarray, "_ 6"]  # x, y (m), angle (rad), their rates (m/s, rad/s)
Points = Float[np.ndarray, "_ 2"]
Point = Float[np.ndarray, "2"]
Lets = Callable[[Points, Points], bool]  # whether obstacles let units go from these points to those
NEVER = np.iinfo(np.int32).max  # the control step in which a thruster that never fails does


def everywhere(begin: Points, end: Points) -> bool:
    """Lets units go anywhere, as water without obstacles does."""
    del begin, end
    return True


@dataclass(frozen=True, eq=False)
class Swimmer:
    """A chain with its target pose; a new one is made wherever something changes."""

    name: int  # number that clients know it by
    units: Float[np.ndarray, "unit 6"]
    links: Float[np.ndarray, "link 6"]
    rest: Float[np.ndarray, "link 2"]  # rad, as in physics.Chain.rest_angle
    works: Bool[np.ndarray, " unit"]  # whether the unit's thruster is on
    gain: Float[np.ndarray, " unit"]  # of the unit's thruster where it is on
    fails_at: Int[np.ndarray, " unit"]  # control step in which the unit's thruster goes off
    target: Float[np.ndarray, "unit 2"]  # m
    turn: float = 0.0  # rad, how far the target pose was turned so far
    thrust: Float[np.ndarray, " unit"] | None = None  # N, of the last step
    distance: float = 0.0  # m, mean, to the target
    reached: bool = False
    since: int = 0  # control steps since the target was changed
    arrived: int | None = None  # control steps that the way to this target took
    memory: Float[np.ndarray, "unit number"] | None = None  # of faulty sensors; None: they begin
    seen: Float[np.ndarray, "unit feature"] | None = None  # shown to the controller before
    trip: Any = None  # through an opening, of a chain that takes itself apart (web.apart)

    @property
    def length(self) -> int:
        """Units."""
        return len(self.units)

    @property
    def is_apart(self) -> bool:
        """Whether it has taken itself apart and is not one chain again."""
        return self.trip is not None and not self.trip.whole

    @property
    def cuts(self) -> Bool[np.ndarray, " unit"]:
        """Whether each unit's link to the next one is cut."""
        cut = np.zeros(self.length, bool)
        if self.trip is not None:
            cut[:-1] = ~self.trip.linked[: self.length - 1]
        return cut

    @property
    def pushes(self) -> Float[np.ndarray, " unit"]:
        """Thrusts of the last step (N)."""
        return np.zeros(self.length) if self.thrust is None else self.thrust


def straight(name: int, length: int, centre: Point, angle: float, target: Points) -> Swimmer:
    """A chain at rest around a point, its links closed."""
    along = LINK * np.array([np.cos(angle), np.sin(angle)])
    place = centre + (np.arange(length) - (length - 1) / 2)[:, None] * along
    units = np.zeros((length, 6))
    units[:, :2], units[:, ANGLE] = place, angle
    links = (units[1:] + units[:-1]) / 2
    rest, works, gain = np.zeros((length - 1, 2)), np.ones(length, bool), np.ones(length)
    fails_at = np.full(length, NEVER)
    return aimed(Swimmer(name, units, links, rest, works, gain, fails_at, target), target)


def aimed(one: Swimmer, target: Points, turn: float = 0.0) -> Swimmer:
    """The swimmer with another target; its clock starts anew."""
    target = np.asarray(target, float)
    apart = float(np.linalg.norm(one.units[:, :2] - target, axis=-1).mean())
    return replace(
        one, target=target, turn=turn, since=0, arrived=None, distance=apart, reached=False
    )


def placed(one: Swimmer, centre: Point, turn: float) -> Swimmer:
    """The swimmer with its target pose moved to a centre and turned to an angle."""
    by = turn - one.turn
    cos, sin = np.cos(by), np.sin(by)
    shape = (one.target - one.target.mean(axis=0)) @ np.array([[cos, sin], [-sin, cos]])
    return aimed(one, shape + centre, turn)


def grown(one: Swimmer, others: Points, lets: Lets = everywhere) -> Swimmer:
    """The swimmer with one more unit at its end, at rest relative to its neighbour.

    Raises:
        InputError: there is no room at its end; `others` are the centres (m) of all other units.
    """
    last = one.units[-1]
    away = one.units[-1, :2] - one.units[-2, :2]
    bearing = np.arctan2(away[1], away[0])
    taken = np.concatenate([one.units[:-1, :2], others])
    for angle in bearing + LEANS:
        place = last[:2] + LINK * np.array([np.cos(angle), np.sin(angle)])
        free = np.linalg.norm(taken - place, axis=1).min() > ROOM
        if free and lets(last[None, :2], place[None]):
            break
    else:
        raise InputError("there is no room at the end of the chain: let it uncurl first")
    facing = last[ANGLE] + _wrapped(angle - last[ANGLE])  # the link's angle, near the unit's own
    unit, link = last.copy(), last.copy()
    unit[:2], unit[ANGLE] = place, facing
    link[:2], link[ANGLE] = (place + last[:2]) / 2, facing
    ahead = one.target[-1] - one.target[-2]
    more = one.target[-1] + LINK * ahead / max(np.linalg.norm(ahead), 1e-9)
    longer = replace(
        one,
        units=np.vstack([one.units, unit]),
        links=np.vstack([one.links, link]),
        rest=np.vstack([one.rest, np.zeros(2)]),
        works=np.append(one.works, True),
        gain=np.append(one.gain, 1.0),
        fails_at=np.append(one.fails_at, NEVER),
        memory=None,
        seen=None,
        thrust=np.append(one.pushes, 0.0),
        target=np.vstack([one.target, more]),
    )
    return aimed(longer, longer.target, one.turn)


def shrunk(one: Swimmer) -> Swimmer:
    """The swimmer without its last unit.

    Raises:
        InputError: it has no more than a chain needs.
    """
    if one.length <= SHORTEST:
        raise InputError(f"a chain has at least {SHORTEST} units")
    return _part(one, 0, one.length - 1)


def _part(one: Swimmer, first: int, end: int) -> Swimmer:
    """Units first to end (not counted) with the links between them, and their target points."""
    part = replace(
        one,
        units=one.units[first:end],
        links=one.links[first : end - 1],
        rest=one.rest[first : end - 1],
        works=one.works[first:end],
        gain=one.gain[first:end],
        fails_at=one.fails_at[first:end],
        memory=None if one.memory is None else one.memory[first:end],
        seen=None if one.seen is None else one.seen[first:end],
        thrust=one.pushes[first:end],
        target=one.target[first:end],
    )
    return aimed(part, part.target, one.turn)


def cut(one: Swimmer, link: int, name: int) -> tuple[Swimmer, Swimmer]:
    """Two swimmers, the second with this name: the link is gone, their targets drift apart.

    Raises:
        InputError: no such link, or a part would be too short for a chain.
    """
    if not 0 <= link < one.length - 1:
        raise InputError(f"the chain has links 0 to {one.length - 2}, got {link}")
    if min(link + 1, one.length - link - 1) < SHORTEST:
        raise InputError(f"each part must keep at least {SHORTEST} units: cut nearer the middle")
    parts = _part(one, 0, link + 1), replace(_part(one, link + 1, one.length), name=name)
    centres = [part.target.mean(axis=0) for part in parts]
    way = centres[1] - centres[0]
    apart = 1.5 * LINK * way / max(np.linalg.norm(way), 1e-9)
    first, second = parts
    return (
        aimed(first, first.target - apart, one.turn),
        aimed(second, second.target + apart, one.turn),
    )


def turned_round(one: Swimmer) -> Swimmer:
    """The same chain counted from its other end.

    A unit's angle points to the next unit, so each turns by half a turn, and a thrust's sign with
    it; a unit is the same seen from either side, so nothing moves.
    """
    units, links = one.units[::-1].copy(), one.links[::-1].copy()
    units[:, ANGLE] += np.pi
    links[:, ANGLE] += np.pi
    return replace(
        one,
        units=units,
        links=links,
        rest=one.rest[::-1, ::-1].copy(),
        works=one.works[::-1].copy(),
        gain=one.gain[::-1].copy(),
        fails_at=one.fails_at[::-1].copy(),
        memory=None,
        seen=None,
        thrust=-one.pushes[::-1],
        target=one.target[::-1].copy(),
    )


def joined(one: Swimmer, other: Swimmer, lets: Lets = everywhere) -> Swimmer:
    """One swimmer of both, linked where their ends are nearest; keeps the first one's name.

    The other comes nearer until the link fits, and the link is stiff at the angle at which they
    lie. The target is the first one's, gone on straight.

    Raises:
        InputError: no two ends are near, or an obstacle is in the way.
    """
    one, other, gap = _end_to_end(one, other)
    if gap > REACH:
        raise InputError(
            f"the nearest ends are {100 * gap:.0f} cm apart: bring them within {100 * REACH:.0f} cm"
        )
    way = other.units[0, :2] - one.units[-1, :2]
    hop = way * (LINK / max(np.linalg.norm(way), 1e-9) - 1)
    places = other.units[:, :2] + hop
    if not (lets(other.units[:, :2], places) and lets(one.units[-1:, :2], places[:1])):
        raise InputError("a wall or a post is in the way of the joint: bring the ends elsewhere")
    facing = one.units[-1, ANGLE]
    angle = facing + _wrapped(np.arctan2(way[1], way[0]) - facing)
    link = (one.units[-1] + other.units[0]) / 2
    link[:2], link[ANGLE], link[SPIN] = one.units[-1, :2] + (way + hop) / 2, angle, 0.0
    shift = np.array([*hop, 0, 0, 0, 0])
    sides = [angle - one.units[-1, ANGLE], angle - other.units[0, ANGLE]]
    whole = replace(
        one,
        units=np.vstack([one.units, other.units + shift]),
        links=np.vstack([one.links, link, other.links + shift]),
        rest=np.vstack([one.rest, [sides], other.rest]),
        works=np.concatenate([one.works, other.works]),
        gain=np.concatenate([one.gain, other.gain]),
        fails_at=np.concatenate([one.fails_at, other.fails_at]),
        memory=None,
        seen=None,
        thrust=np.concatenate([one.pushes, other.pushes]),
        target=_gone_on(one.target, other.length),
    )
    return aimed(whole, whole.target, one.turn)


def _end_to_end(one: Swimmer, other: Swimmer) -> tuple[Swimmer, Swimmer, float]:
    """Both turned round where needed so that the first's end is next to the other's start."""
    pairs = [
        (a, b, float(np.linalg.norm(a.units[-1, :2] - b.units[0, :2])))
        for a in (one, turned_round(one))
        for b in (other, turned_round(other))
    ]
    return min(pairs, key=lambda pair: pair[2])


def _gone_on(points: Points, count: int) -> Points:
    """The points and so many more straight on."""
    ahead = points[-1] - points[-2]
    step = LINK * ahead / max(np.linalg.norm(ahead), 1e-9)
    return np.vstack([points, points[-1] + np.arange(1, count + 1)[:, None] * step])


def _wrapped(angle: float) -> float:
    return float(np.mod(angle + np.pi, 2 * np.pi) - np.pi)
