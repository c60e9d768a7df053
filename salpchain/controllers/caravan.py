"""A planner of sizes above a learned policy: a chain parts to pass an opening, and joins again.

The chain is cut into equal pieces that fit the opening. They go one after another, each by
way-points: out of the line, before the opening, behind it, beside its place in the target pose, and
sideways into that place, where it docks to the piece before it. Between way-points a piece turns
where it stands and goes straight on, broadside, behind a reference pose that waits for it. A leg of
the way is entered only once the piece before has left it, so that no two pieces meet. The policy
steers every piece as a chain of its own: the units' places in the reference are its target.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from salpchain.controllers.greedy import as_action
from salpchain.controllers.named import controller
from salpchain.controllers.pieces import along, ends, means, steered
from salpchain.controllers.policy import Controller, PolicyCard
from salpchain.errors import InputError
from salpchain.given import instance
from salpchain.physics.docking import openings
from salpchain.physics.sizes import LINK_LENGTH, UNIT_LENGTH
from salpchain.physics.state import Physics, wrap
from salpchain.switches import standard_promotion
from salpchain.tasks.checks import check_state
from salpchain.tasks.observations import observe
from salpchain.tasks.parting.course import Course
from salpchain.tasks.state import State

# All chosen
MARGINS = (0.04, 0.012)  # m, between a piece and either side of an opening; the least there may be
ROOM = 0.08  # m, left free around a piece that turns
SPEED = 0.14  # m/s, of a reference, and of its ends where it turns
BERTHING = 0.06  # m/s, at most on the last way into its place, and the slower the nearer
CREEP = 0.015  # m/s, at least
NEAR, LOST = 0.025, 0.07  # m, a unit is so far from its reference: up to here it goes on; it waits
THERE = 0.03  # m, from which on a piece is at a way-point
NEARLY = 0.3  # of the last way into its place, when a piece makes way beside it
FINE = 0.008  # m, at which a joint is closed
# Control steps, beyond what the last way takes, after which ...
PATIENCE = 60  # a joint is closed from as far as it closes at all
RETRY = 210  # a piece goes back and comes again
WAIT, LEAVE, LANE, ASIDE, BERTH, PLACED = range(6)  # stages of a piece
LEGS = 16  # more than a lane has points: stage and leg are one number


class Route(NamedTuple):
    """The ways of the pieces in the order in which they go; slots beyond their number are empty."""

    rank: Int[Array, " unit"]  # in which piece each unit is
    count: Int[Array, ""]
    anchor: Float[Array, "unit 2"]  # m, where each unit is at first
    arm: Float[Array, " unit"]  # m, along its piece from the middle
    half: Float[Array, " piece"]  # m, from the middle of a piece to its outermost units
    leave: Float[Array, "piece 2"]  # m, out of the line
    lane: Float[Array, "piece point 2"]  # m, before, in and behind an opening
    place: Float[Array, "piece 2"]  # m, middle of its place in the target
    angle: Float[Array, " piece"]  # rad, there
    away: Float[Array, "piece 2"]  # m, from there to where it waits beside


class Convoy(NamedTuple):
    """What the planner remembers: the ways, and how far each piece is."""

    route: Route
    progress: Int[Array, " piece"]  # LEGS x stage + leg of the lane
    centre: Float[Array, "piece 2"]  # m, of the reference
    angle: Float[Array, " piece"]  # rad
    off: Float[Array, " piece"]  # share of `away` that a piece is from its place
    going: Bool[Array, " piece"]  # whether it goes straight on
    clock: Int[Array, " piece"]  # control steps in this stage


class Caravan(eqx.Module):
    """Parts, passes and joins where a task has a course; elsewhere it is the policy below it.

    Raises:
        InputError: a guide that is none, that remembers, or that observes several control steps.
    """

    guide: Controller = eqx.field(default="any-length", converter=controller)

    def __check_init__(self) -> None:
        if self.guide.card.action == "grip" or "*" in self.guide.card.observation:
            card = self.guide.card
            raise InputError(
                f"caravan needs a policy of thrusts that observes one control step, got {card.name}"
                f" with action {card.action} and observation {card.observation}"
            )

    @property
    def card(self) -> PolicyCard:
        """Observes as its policy does, and lets go and takes hold."""
        observation = self.guide.card.observation
        return PolicyCard(
            name="caravan", observation=observation, action="grip", task_name="passage"
        )

    @standard_promotion
    def begin(self, state: State) -> Any:
        """The ways of all pieces before the first step."""
        check_state(state, "begin")
        return _convoy(state) if isinstance(state.plan, Course) else ()

    @standard_promotion
    def plan(self, state: State, memory: Any) -> tuple[Float[Array, "unit act"], Any]:
        """Thrusts and grips of every unit, and how far the pieces are then."""
        check_state(state, "plan")
        if not isinstance(state.plan, Course):
            return as_action(self._thrust(state, state.target), "grip"), memory
        instance("memory", memory, Convoy, "what begin or plan gave")
        convoy, aim = _advanced(state, memory)
        hold, berthing = _hold(state, convoy), _stage(convoy)[convoy.route.rank] == BERTH
        exact = steered(state.seen, aim, convoy.route.rank)
        thrust = jnp.where(berthing, exact, self._thrust(state, aim))
        action = as_action(thrust, "grip")
        return action.at[:-1, 1].set(jnp.where(hold, 0.0, -1.0)), convoy

    def act(self, state: State) -> Float[Array, "unit act"]:
        """What it would do in a first step."""
        return self.plan(state, self.begin(state))[0]

    def _thrust(self, state: State, aim: Float[Array, "unit 2"]) -> Float[Array, " unit"]:
        """What the policy would do for this target (m)."""
        obs = observe(self.guide.card.observation, state.seen, aim, state.force)
        state = eqx.tree_at(lambda s: (s.target, s.obs), state, (aim, obs))
        action = jnp.clip(self.guide.act(state), -1.0, 1.0)
        if self.guide.card.action == "pair":
            return (action[:, 0] - action[:, 1]) / 2
        return action[:, 0]


def _convoy(state: State) -> Convoy:
    route, middle, angle = _route(state)
    none = jnp.zeros_like(angle)
    return Convoy(
        route=route,
        progress=jnp.zeros_like(none, dtype=jnp.int32),
        centre=middle,
        angle=angle,
        off=none + 1.0,
        going=none > 0,
        clock=jnp.zeros_like(none, dtype=jnp.int32),
    )


def _route(state: State) -> tuple[Route, Array, Array]:
    """The ways, and where the pieces are at first: their middles (m) and angles (rad)."""
    chain, course, target = state.seen, state.plan, state.target
    rank, count = _ranks(state)
    first, last = outer = ends(rank, chain.present)
    size = last - first + 1
    middle, place = (means(x, rank, chain.present) for x in (chain.units.position, target))
    alone = jnp.where(size > 1, along(chain.units.position, outer), chain.units.angle[first])
    angle = along(target, (jnp.maximum(first - (size < 2), 0), last + (size < 2)))
    half = (size - 1) / 2 * LINK_LENGTH
    room = half + LINK_LENGTH + ROOM
    lane = _lane(course.lanes, middle, room)
    source = lane[:, -1] if lane.shape[1] else middle
    away = _side(source - place, angle, room)
    goal = lane[:, 0] if lane.shape[1] else place + away
    out = _side(goal - middle, alone, room)
    if not lane.shape[1]:  # straight on to the line beside the target, if it is not so far from it
        across = away / room[:, None]
        height = jnp.sum((middle - place) * across, axis=-1)
        out = across * jnp.maximum(room - height, 0.0)[:, None]
    leave = middle + jnp.where(count > 1, out, 0.0)
    slot = jnp.arange(len(rank))
    arm = (slot - (first + last)[rank] / 2) * LINK_LENGTH
    anchor = chain.units.position
    return Route(rank, count, anchor, arm, half, leave, lane, place, angle, away), middle, alone


def _ranks(state: State) -> tuple[Int[Array, " unit"], Int[Array, ""]]:
    """In which piece each unit is, in the order in which they go, and how many there are.

    The end of the target that is farther from the way through is filled first.
    """
    chain, course = state.seen, state.plan
    length, slot = chain.present.sum(), jnp.arange(len(chain.present))
    fits = [
        jnp.floor((course.width - 2 * margin - UNIT_LENGTH) / LINK_LENGTH + 1e-4) + 1
        for margin in MARGINS
    ]
    most = jnp.where(fits[0] >= 2, fits[0], jnp.minimum(fits[1], 2.0))
    most = jnp.clip(most, 1, length).astype(int)
    pieces = (length + most - 1) // most
    cut = jnp.diff(slot * pieces // length) > 0
    parted = (chain.held & ~chain.joined) | (chain.held & cut)
    piece = jnp.concatenate([jnp.zeros(1, int), jnp.cumsum(parted)])
    count = piece[-1] + 1
    if not course.lanes.shape[0]:
        return piece, count
    behind = course.lanes[:, -1].mean(axis=0)
    first, last = (jnp.linalg.norm(state.target[k] - behind) for k in (0, length - 1))
    return jnp.where(first < last, count - 1 - piece, piece), count


def _side(towards: Array, angle: Array, size: Array) -> Float[Array, "piece 2"]:
    """A vector of this size (m) across a piece, to the side on which something lies."""
    across = jnp.stack([-jnp.sin(angle), jnp.cos(angle)], axis=-1)
    sign = jnp.where(jnp.sum(towards * across, axis=-1) < 0, -1.0, 1.0)
    return across * (sign * size)[:, None]


def _lane(lanes: Array, start: Array, room: Array) -> Float[Array, "piece point 2"]:
    """The nearest way through for each piece, with room to turn before and behind it."""
    if not lanes.shape[0]:
        return jnp.zeros((len(start), 0, 2))
    apart = jnp.linalg.norm(lanes[None, :, 0] - start[:, None], axis=-1)
    lane = lanes[jnp.argmin(apart, axis=1)]

    def on(one: Array, other: Array) -> Array:
        step = one - other
        return room[:, None] * step / jnp.linalg.norm(step, axis=-1, keepdims=True)

    before, behind = on(lane[:, 0], lane[:, 1]), on(lane[:, -1], lane[:, -2])
    return lane.at[:, 0].add(before).at[:, -1].add(behind)


def _advanced(state: State, convoy: Convoy) -> tuple[Convoy, Float[Array, "unit 2"]]:
    """The convoy a control step later, and the target point (m) of every unit."""
    chain, route = state.seen, convoy.route
    aim = _aim(state, convoy)
    apart = jnp.linalg.norm(chain.units.position - aim, axis=-1)
    lost = jax.ops.segment_max(jnp.where(chain.present, apart, 0.0), route.rank, len(apart))
    convoy, at_goal = _driven(convoy, lost)
    convoy = _berthing(convoy, lost)
    convoy = _onward(state, convoy, at_goal & (lost < THERE), lost)
    return convoy, _aim(state, convoy)


def _stage(convoy: Convoy) -> Int[Array, " piece"]:
    return convoy.progress // LEGS


def _aim(state: State, convoy: Convoy) -> Float[Array, "unit 2"]:
    """The target points (m) that units have on their ways."""
    route, stage = convoy.route, _stage(convoy)
    rank = route.rank
    axis = jnp.stack([jnp.cos(convoy.angle), jnp.sin(convoy.angle)], axis=-1)[rank]
    straight = convoy.centre[rank] + route.arm[:, None] * axis
    berth = state.target + (convoy.off[:, None] * route.away)[rank]
    own = stage[rank][:, None]
    return jnp.where(own == WAIT, route.anchor, jnp.where(own >= BERTH, berth, straight))


def _driven(convoy: Convoy, lost: Array) -> tuple[Convoy, Bool[Array, " piece"]]:
    """References a control step further to their way-points, and which are there.

    A reference turns where it is until it stands across its way, and waits for its piece.
    """
    goal, final, route = _goal(convoy), _stage(convoy) == ASIDE, convoy.route
    step = SPEED * CONTROL_STEP * jnp.clip((LOST - lost) / (LOST - NEAR), 0.0, 1.0)
    gap = goal - convoy.centre
    distance = jnp.linalg.norm(gap, axis=-1)
    far = distance > 1e-4
    course = jnp.arctan2(gap[:, 1], gap[:, 0]) - jnp.pi / 2 - convoy.angle
    turn = jnp.mod(course + jnp.pi / 2, jnp.pi) - jnp.pi / 2  # it swims either way
    turn = jnp.where(far, turn, jnp.where(final, wrap(route.angle - convoy.angle), 0.0))
    most = step / (route.half + LINK_LENGTH / 2)
    aligned = jnp.abs(turn) < 1e-3
    going = far & aligned & (convoy.going | (lost < NEAR))
    way = jnp.where(going, jnp.minimum(step, distance), 0.0)
    centre = convoy.centre + gap * (way / jnp.maximum(distance, 1e-6))[:, None]
    angle = convoy.angle + jnp.where(going, turn, jnp.clip(turn, -most, most))
    there = (distance - way < 1e-4) & (~final | (jnp.abs(wrap(route.angle - angle)) < 1e-2))
    moving = (_stage(convoy) >= LEAVE) & (_stage(convoy) <= ASIDE)
    centre = jnp.where(moving[:, None], centre, convoy.centre)
    angle = jnp.where(moving, angle, convoy.angle)
    return convoy._replace(centre=centre, angle=angle, going=going), there


CONTROL_STEP: float = Physics.control_step  # s  # pyright: ignore[reportAssignmentType]


def _goal(convoy: Convoy) -> Float[Array, "piece 2"]:
    """The way-point (m) of each piece."""
    route, stage = convoy.route, _stage(convoy)[:, None]
    goal = jnp.where(stage == LEAVE, route.leave, route.place + route.away)
    if not route.lane.shape[1]:
        return goal
    leg = jnp.clip(convoy.progress % LEGS, 0, route.lane.shape[1] - 1)
    point = jnp.take_along_axis(route.lane, leg[:, None, None], axis=1)[:, 0]
    return jnp.where(stage == LANE, point, goal)


def _berthing(convoy: Convoy, lost: Array) -> Convoy:
    """Pieces that berth a control step nearer to their places."""
    size = jnp.linalg.norm(convoy.route.away, axis=-1)
    left = convoy.off * size
    speed = jnp.clip(0.5 * left, CREEP, BERTHING) * (lost < LOST / 2)
    nearer = jnp.maximum(left - speed * CONTROL_STEP, 0.0) / jnp.maximum(size, 1e-6)
    return convoy._replace(off=jnp.where(_stage(convoy) >= BERTH, nearer, convoy.off))


def _last_way(route: Route) -> Float[Array, " piece"]:
    """Control steps that the way into its place takes at full speed."""
    return jnp.linalg.norm(route.away, axis=-1) / (BERTHING * CONTROL_STEP)


def _onward(state: State, convoy: Convoy, there: Array, lost: Array) -> Convoy:
    """Pieces that go on to their next way-points, where the piece before them has made way."""
    route, progress = convoy.route, convoy.progress
    stage, leg, points = _stage(convoy), convoy.progress % LEGS, convoy.route.lane.shape[1]
    before = jnp.concatenate([jnp.full(1, PLACED * LEGS), progress[:-1]])
    joined, last = _docked(state, convoy), leg >= points - 1
    placed = (convoy.off <= 0) & (lost < THERE)
    placed = jnp.where(jnp.arange(len(stage)) == 0, placed, joined)
    if points:
        first, then = LANE * LEGS + 1, LANE * LEGS
        lane = jnp.where(leg == 0, before >= BERTH * LEGS, True)
    else:
        first, then, lane = PLACED * LEGS, ASIDE * LEGS, jnp.ones_like(there)
    off = jnp.concatenate([jnp.zeros(1), convoy.off[:-1]])
    nearly_in = (before >= BERTH * LEGS) & (off < NEARLY)
    clear = jnp.select(
        [stage == WAIT, stage == LEAVE, stage == LANE, stage == ASIDE, stage == BERTH],
        [
            before >= first,
            there & (before >= (ASIDE * LEGS if points else 0)),
            there & jnp.where(last, nearly_in, lane),
            there & (before >= PLACED * LEGS),
            placed,
        ],
        False,
    ) & (jnp.arange(len(stage)) < route.count)
    to_next = jnp.where((stage == LANE) & ~last, progress + 1, (stage + 1) * LEGS)
    onward = jnp.where(stage == LEAVE, then, to_next)
    again = (stage == BERTH) & ~clear & (convoy.clock > RETRY + _last_way(route))
    after = jnp.where(clear, onward, jnp.where(again, ASIDE * LEGS, progress))
    off = jnp.where(again, 1.0, convoy.off)
    clock = jnp.where(after != progress, 0, convoy.clock + 1)
    changed = after != progress
    return convoy._replace(progress=after, off=off, clock=clock, going=convoy.going & ~changed)


def _docked(state: State, convoy: Convoy) -> Bool[Array, " piece"]:
    """Which pieces are joined to the one that went before them."""
    rank, linked = convoy.route.rank, state.chain.joined
    later = jnp.maximum(rank[:-1], rank[1:])
    between = linked & (rank[:-1] != rank[1:])
    return jax.ops.segment_max(between.astype(int), later, len(rank)) > 0


def _hold(state: State, convoy: Convoy) -> Bool[Array, " link"]:
    """Which links are held, or closed where they can be."""
    rank, chain = convoy.route.rank, state.seen
    stage = _stage(convoy)[rank]
    inside, waiting = rank[:-1] == rank[1:], (stage[:-1] == WAIT) & (stage[1:] == WAIT)
    berthed = (stage[:-1] >= BERTH) & (stage[1:] >= BERTH)
    gap = openings(chain, Physics())[:, 0]
    over = convoy.clock - _last_way(convoy.route)
    late = jnp.minimum(over[rank[:-1]], over[rank[1:]]) > PATIENCE
    return inside | waiting | (berthed & (chain.linked | (gap <= FINE) | late))
