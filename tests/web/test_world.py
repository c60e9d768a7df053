"""The live world: its steps are those of the domain, and edits do what they say."""

import equinox as eqx
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

from salpchain.controllers.greedy import Greedy
from salpchain.controllers.policy import Policy, PolicyCard
from salpchain.errors import InputError
from salpchain.networks.actor_critic import actor_critic
from salpchain.networks.config import ControlConfig
from salpchain.physics.state import at_rest
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.reach.task import SCLD
from salpchain.web import swimmer
from salpchain.web.drawing import SHARPEST, nearer_way_round, random_target, resampled
from salpchain.web.pool import CHAINS, Pool, slots_for
from salpchain.web.swimmer import ANGLE, LINK, straight
from salpchain.web.world import World

POOL = Pool()


def gcn():
    card = PolicyCard(name="fresh")
    return Policy(actor_critic(jr.key(1), card.control, 22, 1, 8), card)


@pytest.fixture
def world():
    world = World(seed=2)
    world.reset(6)
    return world


def only(world):
    (one,) = world.swimmers
    return one


def swim(world, steps, controller=None):
    for _ in range(steps):
        world.advance(POOL, controller or Greedy())


def test_a_chain_swims_as_it_would_in_the_domain(world):
    """The reference: SCLD itself, in as many slots as the chain has units."""
    one, policy, env = only(world), gcn(), SCLD(TaskConfig(6))
    chain = at_rest(jnp.asarray(one.units[:, :2]), jnp.asarray(one.units[:, ANGLE]))
    state = env.start(chain, jnp.asarray(one.target), jr.key(0))
    step = eqx.filter_jit(lambda state: env.step(state, policy.act(state)))
    for _ in range(10):
        state, _ = step(state), world.advance(POOL, policy)
        np.testing.assert_allclose(only(world).units[:, :2], state.chain.units.position, atol=2e-4)
    np.testing.assert_allclose(only(world).thrust, state.thrust, atol=5e-3)
    np.testing.assert_allclose(only(world).distance, state.distances.mean, atol=1e-4)


def test_after_a_cut_each_chain_swims_as_if_alone(world):
    policy = gcn()
    world.cut(only(world).name, 2)
    first, second = world.swimmers
    second_target = second.target + np.array([0.0, 3.0])
    world.swimmers[1] = swimmer.aimed(second, second_target)
    alone = World(swimmers=[world.swimmers[0]])
    other = World(swimmers=[world.swimmers[1]])
    assert first.name != second.name and first.length == second.length == 3
    for apart in (world, alone, other):  # far from each other, so that they never touch
        moved = [one if one.name == first.name else _shifted(one, 1.0) for one in apart.swimmers]
        apart.swimmers = moved
        swim(apart, 8, policy)
    np.testing.assert_allclose(world.swimmers[0].units, only(alone).units, atol=1e-3)
    np.testing.assert_allclose(world.swimmers[1].units, only(other).units, atol=1e-3)


def _shifted(one, by):
    units, links = one.units.copy(), one.links.copy()
    units[:, 0] += by
    links[:, 0] += by
    return swimmer.replace(one, units=units, links=links, target=one.target + np.array([by, 0]))


def test_two_chains_that_meet_push_each_other():
    ahead, none = np.array([0.0, 1.0]), np.zeros(2)
    low = straight(1, 3, none, 0.0, none + ahead + np.arange(3)[:, None] * [LINK, 0])
    high = straight(2, 3, np.array([0.035, 0.3]), 0.0, low.target - 2 * ahead)
    world = World(swimmers=[low, high])
    swim(world, 60)
    heights = [one.units[:, 1].mean() for one in world.swimmers]
    # each wants to be 1 m farther on, but the other stands in its way
    assert max(heights) - min(heights) < 0.1


def test_a_unit_whose_thruster_is_off_pushes_nothing(world):
    world.switch(only(world).name, 3, False)
    swim(world, 2)
    assert only(world).thrust[3] == 0 and np.abs(only(world).thrust[[2, 4]]).min() > 0


def test_a_push_moves_the_chain_once(world):
    for unit in range(6):
        world.switch(only(world).name, unit, False)
    swim(world, 1)
    before = only(world).units[:, 0].mean()
    world.push(only(world).name, 0, 2.0, 0.0)
    swim(world, 3)
    speeds = []
    for _ in range(3):
        speeds.append(np.hypot(*only(world).units[:, 3:5].mean(axis=0)))
        swim(world, 1)
    assert only(world).units[:, 0].mean() > before + 0.02
    assert speeds[2] < 0.7 * speeds[0]  # drag takes it; the push is not repeated


def test_in_a_current_a_chain_without_thrust_drifts_at_its_speed(world):
    for unit in range(6):
        world.switch(only(world).name, unit, False)
    world.flow(0.0, 0.2)
    swim(world, 40)
    np.testing.assert_allclose(only(world).units[:, 3:5], [[0, 0.2]] * 6, atol=2e-3)


def test_grow_and_shrink_keep_every_other_unit_and_every_joint_closed(world):
    before = only(world)
    world.grow(before.name)
    after = only(world)
    np.testing.assert_array_equal(after.units[:6], before.units)
    assert np.linalg.norm(after.units[6, :2] - after.units[5, :2]) == pytest.approx(LINK)
    assert np.linalg.norm(after.target[6] - after.target[5]) == pytest.approx(LINK, abs=1e-4)
    swim(world, 3)
    assert np.linalg.norm(np.diff(only(world).units[:, :2], axis=0), axis=1).max() < 0.075
    world.shrink(before.name)
    assert only(world).length == 6


def test_a_chain_that_curled_up_has_no_room_for_a_unit(world):
    one = only(world)
    crowd = one.units[-1, :2] + LINK * np.array(
        [[np.cos(a), np.sin(a)] for a in np.linspace(0, 6.3, 12)]
    )
    with pytest.raises(InputError, match="no room"):
        swimmer.grown(one, crowd)


def test_join_after_cut_gives_the_same_chain_again(world):
    before = only(world)
    world.cut(before.name, 1)
    first, second = world.swimmers
    world.join(first.name, second.name)
    after = only(world)
    np.testing.assert_allclose(after.units, before.units, atol=1e-9)
    np.testing.assert_allclose(after.links, before.links, atol=1e-9)
    np.testing.assert_allclose(after.rest, before.rest, atol=1e-9)


def test_two_heads_can_be_joined_too_and_the_chain_holds_together(world):
    """The second chain is counted from its other end: nothing may jerk."""
    world.cut(only(world).name, 2)
    first, second = world.swimmers
    world.swimmers[1] = swimmer.turned_round(second)
    world.join(first.name, second.name)
    swim(world, 5)
    gaps = np.linalg.norm(np.diff(only(world).units[:, :2], axis=0), axis=1)
    np.testing.assert_allclose(gaps, LINK, atol=3e-3)


def test_turning_a_chain_round_changes_its_names_not_its_motion(world):
    one = only(world)
    twin = World(swimmers=[swimmer.turned_round(one)])
    swim(world, 6)
    swim(twin, 6)
    ours, theirs = only(world), only(twin)
    np.testing.assert_allclose(ours.units[:, :2], theirs.units[::-1, :2], atol=2e-3)
    np.testing.assert_allclose(ours.thrust, -theirs.thrust[::-1], atol=0.1)


BAD = [
    (lambda w: w.place(99, 0.0, 0.0, 0.0), "no chain 99"),
    (lambda w: w.retarget(99), "no chain 99"),
    (lambda w: w.cut(only(w).name, 0), "at least 2 units"),
    (lambda w: w.cut(only(w).name, 9), "links 0 to 4"),
    (lambda w: w.switch(only(w).name, 6, True), "units 0 to 5"),
    (lambda w: w.push(only(w).name, 6, 1.0, 1.0), "units 0 to 5"),
    (lambda w: w.join(only(w).name, only(w).name), "joined to itself"),
    (lambda w: w.flow(1.0, 0.0), "at most 0.3 m/s"),
    (lambda w: w.draw(only(w).name, [(0.0, 0.0), (0.0, 0.001)]), "longer line"),
    (lambda w: w.reset(129), "at most 128"),
    (lambda w: w.reset(1), "2 to 1024"),
]


@pytest.mark.parametrize(("edit", "says"), BAD, ids=[says for _, says in BAD])
def test_an_edit_that_cannot_be_changes_nothing(world, edit, says):
    before = only(world)
    with pytest.raises(InputError, match=says):
        edit(world)
    assert only(world) is before


def test_chains_are_neither_too_many_nor_too_short(world):
    world.reset(2 * CHAINS + 2)
    for _ in range(CHAINS - 1):
        world.cut(world.swimmers[-1].name, 1)
    with pytest.raises(InputError, match=f"{CHAINS} chains"):
        world.cut(world.swimmers[-1].name, 1)
    world.reset(2)
    with pytest.raises(InputError, match="at least 2"):
        world.shrink(only(world).name)


def test_a_controller_of_one_length_allows_no_other(world):
    card = PolicyCard("mlp-6", ControlConfig(model="mlp"), length=6)
    policy = Policy(actor_critic(jr.key(0), card.control, 22, 1, 6), card)
    world.steer_by(card)
    swim(world, 1, policy)
    assert np.abs(only(world).thrust).max() > 0
    for edit in (world.grow, world.shrink, lambda name: world.cut(name, 2)):
        with pytest.raises(InputError, match="works at 6 units only"):
            edit(only(world).name)
    world.steer_by(Greedy().card)
    world.grow(only(world).name)
    with pytest.raises(InputError, match="works at 6 units only"):
        world.steer_by(card)


def test_edits_compile_nothing(world):
    swim(world, 1)
    count = len(POOL._compiled)
    for _ in range(4):
        world.grow(world.swimmers[0].name)
        swim(world, 1)
    world.cut(world.swimmers[0].name, 4)
    swim(world, 1)
    assert len(POOL._compiled) == count
    assert [slots_for(n) for n in (2, 64, 65, 128)] == [64, 64, 128, 128]


def test_placing_a_target_moves_and_turns_it_rigidly(world):
    before = only(world).target
    world.place(only(world).name, 1.0, -2.0, np.pi / 2)
    after = only(world).target
    np.testing.assert_allclose(after.mean(axis=0), [1, -2], atol=1e-9)
    turned = (before - before.mean(axis=0)) @ np.array([[0, 1], [-1, 0]])
    np.testing.assert_allclose(after - after.mean(axis=0), turned, atol=1e-9)
    world.place(only(world).name, *before.mean(axis=0), 0.0)
    np.testing.assert_allclose(only(world).target, before, atol=1e-9)


def test_a_new_target_is_near_the_chain_wherever_it_is_and_its_clock_starts_again(world):
    world.place(only(world).name, 30.0, 0.0, 0.0)
    far = _shifted(only(world), 30.0)
    world.swimmers = [swimmer.replace(far, reached=True, arrived=7, since=9)]
    seen = [far.target]
    for _ in range(5):
        world.retarget(far.name)
        one = only(world)
        assert 0.1 < one.distance < 1.0  # m; within reach of 6 units, and not where they are
        assert (one.reached, one.arrived, one.since) == (False, None, 0)
        assert one.units is far.units
        assert min(np.abs(one.target - other).max() for other in seen) > 1e-3
        seen.append(one.target)


DICE = np.random.default_rng(0)
LINES = {
    "straight": np.array([[0.0, 0], [3, 0]]),
    "dots close together": np.stack([np.linspace(0, 1, 400), np.zeros(400)], 1),
    "zigzag": np.array([[0.2 * i, 0.3 * (i % 2)] for i in range(9)]),
    "too short": np.array([[0, 0], [0.1, 0.1]]),
    "scribble": np.cumsum(DICE.normal(0, 0.05, (200, 2)), axis=0),
    "back on itself": np.array([[0.0, 0], [0.5, 0], [0, 0]]),
    "twice the same point": np.array([[0, 0], [0, 0], [0.4, 0], [0.4, 0], [0.4, 0.4]]),
}


@pytest.mark.parametrize("line", LINES.values(), ids=LINES)
@pytest.mark.parametrize("length", [2, 9])
def test_a_drawing_becomes_chords_that_a_chain_can_take(line, length):
    points = resampled(line, length)
    steps = np.diff(points, axis=0)
    assert points.shape == (length, 2)
    np.testing.assert_allclose(points[0], line[0])
    np.testing.assert_allclose(np.linalg.norm(steps, axis=1), LINK, atol=1e-9)
    bearing = np.arctan2(*steps.T[::-1])
    turns = np.mod(np.diff(bearing) + np.pi, 2 * np.pi) - np.pi
    assert np.abs(turns).max(initial=0) <= SHARPEST + 1e-9


def test_a_smooth_drawing_is_followed():
    angle = np.linspace(0, np.pi, 200)
    points = resampled(0.4 * np.stack([np.cos(angle), np.sin(angle)], 1), 15)
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 0.4, atol=2e-3)


def test_a_drawing_is_taken_from_the_end_that_is_nearer():
    units = np.array([[0.0, 0], [1, 0]])
    np.testing.assert_array_equal(nearer_way_round(units + 0.1, units), units + 0.1)
    np.testing.assert_array_equal(nearer_way_round(units[::-1] + 0.1, units), units + 0.1)


@pytest.mark.parametrize("length", [2, 3, 12, 64])
def test_random_targets_are_chains_near_by(length):
    for _ in range(20):
        target = random_target(DICE, length, np.zeros(2))
        steps = np.linalg.norm(np.diff(target, axis=0), axis=1)
        np.testing.assert_allclose(steps, LINK, atol=1e-9)
        assert np.hypot(*target.mean(axis=0)) < 0.36 + 0.6 * length * LINK


def test_the_same_seed_gives_the_same_world():
    np.testing.assert_array_equal(World(7).swimmers[0].target, World(7).swimmers[0].target)
