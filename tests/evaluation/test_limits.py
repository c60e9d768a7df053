import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from salpchain.evaluation.limits import (
    Means,
    acceleration,
    angle_turned,
    centre_of_mass,
    centroid_slack,
    cruising_speed,
    distance_covered,
    drift,
    fewest_steps,
    least_distance,
    reachable,
    steps_to_turn,
    top_speed,
)
from salpchain.physics.chain import step
from salpchain.physics.state import Physics, at_rest, heading
from salpchain.tasks.config import GOAL_LIMIT
from salpchain.tasks.reach.reward import reached
from salpchain.world.current import Uniform
from salpchain.world.world import World
from tests.physics.poses import LINK, along, bent

PHYSICS = Physics()


def straight(num, physics=PHYSICS):
    position = np.stack([physics.link_length * np.arange(num), np.zeros(num)], -1)
    return at_rest(jnp.array(position, jnp.float32), jnp.zeros(num))


@eqx.filter_jit
def swim(chain, thrusts, physics=PHYSICS):
    """Centres of mass, their velocities, and units' positions, after each control step."""

    def advance(chain, thrust):
        chain = step(chain, thrust, physics, contact=False)
        velocities = jnp.concatenate([chain.units.velocity, chain.links.velocity])
        return chain, (
            centre_of_mass(physics, chain),
            velocities.mean(axis=0),  # all masses are 1 kg
            chain.units.position,
        )

    return jax.lax.scan(advance, chain, thrusts)[1]


@pytest.mark.parametrize("num", [2, 9])
def test_a_straight_chain_under_full_thrust_swims_exactly_at_the_limit(num):
    rigid = Physics(angle_stiffness=5.0)  # a soft one bends: its end units have less to pull
    centres, velocities, positions = swim(straight(num), jnp.ones((40, num)), rigid)
    bound = [distance_covered(rigid, num, k) for k in range(1, 41)]
    np.testing.assert_allclose(centres[:, 1], bound, rtol=1e-3)
    speeds = np.diff(np.asarray(positions[..., 1]).mean(1)) / rigid.control_step
    np.testing.assert_allclose(speeds[-10:].mean(), cruising_speed(rigid, num), rtol=0.01)
    np.testing.assert_allclose(velocities[-1, 1], top_speed(rigid, num), rtol=0.01)
    assert velocities.max() <= top_speed(rigid, num) * (1 + 1e-5)


@pytest.mark.parametrize("num", [3, 8, 9])  # two spin so fast that thrusts, held, point askew
def test_a_straight_stiff_chain_that_thrusts_round_its_middle_turns_at_the_limit(num):
    stiff = Physics(angle_stiffness=20.0, joint_stiffness=1e5, softness=1e-4, substeps=200)
    thrusts = jnp.sign(jnp.arange(num) - (num - 1) / 2)
    _, _, positions = swim(straight(num, stiff), jnp.tile(thrusts, (12, 1)), stiff)
    across, along = np.moveaxis(np.asarray(positions[:, -1] - positions[:, 0]), -1, 0)[::-1]
    turned = np.unwrap(np.arctan2(across, along))
    bound = np.array([angle_turned(stiff, num, k) for k in range(1, 13)])
    assert turned[-1] > 0.4
    np.testing.assert_allclose(turned, bound, rtol=0.02, atol=0.003)  # it flexes at first


@pytest.mark.parametrize("num", [2, 16, 128])
@pytest.mark.parametrize("turn", [0.0, 0.3, 3.0])
def test_the_steps_to_turn_are_the_first_after_which_its_ends_are_where_they_should(num, turn):
    steps = int(steps_to_turn(PHYSICS, num, jnp.float32(turn), 0.05, 4000))
    half = (num - 1) * LINK / 2
    off = [
        2 * half * np.sin(max(turn - float(angle_turned(PHYSICS, num, k)), 0) / 2)  # a chord
        for k in range(1, steps + 1)
    ]
    assert off[-1] <= 0.05 + 1e-4
    assert all(chord > 0.05 - 1e-4 for chord in off[:-1])


def test_the_distance_covered_is_what_the_substeps_add_up_to():
    for physics in (PHYSICS, Physics(drag=0.6, substeps=4), Physics(drag=0.0, control_step=0.2)):
        speed, place, dt = 0.0, 0.0, physics.control_step / physics.substeps
        for taken in range(1, 30):
            speed *= 1 - physics.drag
            for _ in range(physics.substeps):
                speed += acceleration(physics, 5) * dt
                place += speed * dt
            assert distance_covered(physics, 5, taken) == pytest.approx(place, rel=1e-12)
        assert speed <= top_speed(physics, 5)


def test_without_drag_there_is_no_top_speed():
    assert top_speed(Physics(drag=0.0), 8) == np.inf
    assert distance_covered(PHYSICS, 8, 0) == 0


@pytest.mark.parametrize("num", [2, 5, 12])
def test_whatever_the_thrusts_no_chain_gets_beyond_the_limit(num):
    rng = np.random.default_rng(num)
    for attempt in range(3):
        position, angle = bent(rng, 1, num, 0.6)
        chain = at_rest(jnp.array(position[0]), jnp.array(angle[0]))
        towards = heading(chain.units.angle) @ jnp.array([1.0, 0.0])
        thrusts = [jnp.sign(towards), jnp.ones(num), rng.uniform(-1, 1, num)][attempt]
        thrusts = jnp.broadcast_to(jnp.asarray(thrusts, jnp.float32), (60, num))
        centres, _, positions = swim(chain, thrusts)
        apart = np.linalg.norm(centres - centre_of_mass(PHYSICS, chain), axis=-1)
        bound = np.array([distance_covered(PHYSICS, num, k) for k in range(1, 61)])
        assert (apart <= bound * (1 + 1e-4)).all()
        shifted = np.linalg.norm(np.asarray(positions).mean(1) - np.asarray(centres), axis=-1)
        assert (shifted <= centroid_slack(PHYSICS, num)).all()


@pytest.mark.parametrize("num", [2, 3, 4, 9, 64])
def test_a_hairpin_shifts_the_centre_of_mass_most(num):
    away = np.minimum(np.arange(num), np.arange(num)[::-1])
    position = np.stack([LINK * away, np.zeros(num)], -1).astype(np.float32)
    if num % 2 == 0:  # the two units in the middle share a link of their own
        position[num // 2 :, 1] += LINK
    hairpin = shift(at_rest(jnp.array(position), jnp.zeros(num)))
    rigid = Physics(joint_stiffness=1e12, softness=1e-12)
    assert hairpin == pytest.approx(centroid_slack(rigid, num), abs=1e-6)
    rng = np.random.default_rng(num)
    for _ in range(20):
        points, angle = bent(rng, 1, num, 3.0)
        assert shift(at_rest(jnp.array(points[0]), jnp.array(angle[0]))) <= hairpin + 1e-6


def shift(chain):
    """Distance of the units' centroid from the centre of mass of units and links."""
    centroid = np.asarray(chain.units.position).mean(0)
    return float(np.linalg.norm(centroid - np.asarray(centre_of_mass(PHYSICS, chain))))


@pytest.mark.parametrize("away", [0.0, 0.04, 0.3, 2.0])
def test_the_fewest_steps_are_the_first_after_which_the_goal_is_within_reach(away):
    chain = straight(8)
    target = chain.units.position + jnp.array([0.0, away])
    fewest = int(fewest_steps(PHYSICS, chain, target, 0.05, 1000))
    left = [float(least_distance(PHYSICS, chain, target, k)) for k in range(1, fewest + 1)]
    assert left[-1] <= 0.05 + 1e-5
    assert all(distance > 0.05 - 1e-5 for distance in left[:-1])


def to_and_fro(direction, before, after):
    """A row of five links, with as many pairs of links at its two ends, each there and back."""
    pair = [direction, direction + np.pi]
    position, angle = along(np.array([pair * before + [0.0] * 5 + pair * after]))
    return jnp.asarray(position[0], jnp.float32), jnp.asarray(angle[0], jnp.float32)


def test_a_target_taken_by_other_units_than_its_own_needs_no_steps():
    target, _ = to_and_fro(0.0, 1, 5)
    position, angle = to_and_fro(-np.pi / 2, 5, 1)
    chain = at_rest(position + LINK / 2, angle)  # each unit halfway between two target points
    apart = np.linalg.norm(np.asarray(chain.units.position - target), axis=-1)
    assert bool(reached(chain, target)) and apart[1:-1].max() > 5 * GOAL_LIMIT
    assert float(least_distance(PHYSICS, chain, target, 0)) > GOAL_LIMIT  # point for point: not yet
    assert int(few(chain, target)) == 1


@pytest.mark.parametrize("num", [2, 5, 16])
def test_no_steps_are_asked_of_a_chain_that_is_there(num):
    rng = np.random.default_rng(num)
    position, angle = (x.astype(np.float32) for x in bent(rng, 20, num, 0.6))
    off = rng.normal(size=(20, num, 2))
    off *= 0.99 * GOAL_LIMIT / np.linalg.norm(off, axis=-1).max(axis=1)[:, None, None]
    for points, angles, there in zip(position, angle, position + off, strict=True):
        chain = at_rest(jnp.array(points), jnp.array(angles))
        assert int(few(chain, jnp.array(there, jnp.float32))) == 1


@eqx.filter_jit
def few(chain, target):
    """Steps to the goal of the task."""
    return fewest_steps(PHYSICS, chain, target, GOAL_LIMIT, 1000)


def test_a_target_within_reach_can_be_closed_in_full_and_a_far_one_by_speed_times_time():
    chain = straight(8)
    near, far = (chain.units.position + jnp.array([0.0, y]) for y in (0.5, 100.0))
    assert float(reachable(PHYSICS, chain, near, 512)) == 1.0
    limit = distance_covered(PHYSICS, 8, 512) + centroid_slack(PHYSICS, 8)
    assert float(least_distance(PHYSICS, chain, far, 512)) == pytest.approx(100 - limit, rel=1e-5)
    assert float(reachable(PHYSICS, chain, far, 512)) == pytest.approx(limit / 100, rel=1e-4)


FLOW = np.array([0.03, -0.05])


def carried(thrust, steps, physics=PHYSICS):
    """Ways of the centre of mass of a straight chain of 6 in a uniform current."""
    world, chain = World(physics, current=Uniform(FLOW)), straight(6, physics)
    start = centre_of_mass(physics, chain)

    def advance(chain, _):
        chain = world.step(chain, jnp.full(6, thrust), contact=False)
        return chain, centre_of_mass(physics, chain) - start

    return np.asarray(jax.jit(lambda: jax.lax.scan(advance, chain, None, steps)[1])())


def test_a_chain_without_thrust_drifts_as_the_closed_form_says():
    ways = carried(0.0, 40)
    bound = [FLOW * drift(PHYSICS, k) for k in range(1, 41)]
    np.testing.assert_allclose(ways, bound, rtol=1e-3, atol=1e-6)
    assert float(drift(Physics(drag=0.0), 40)) == 0  # nothing carries what has no drag


def test_thrust_and_water_add_up():
    rigid = Physics(angle_stiffness=5.0)
    ways = carried(1.0, 40, rigid)
    own = [float(distance_covered(rigid, 6, k)) for k in range(1, 41)]
    along = FLOW[1] * np.array([float(drift(rigid, k)) for k in range(1, 41)])
    np.testing.assert_allclose(ways[:, 1], own + along, rtol=2e-3, atol=1e-4)


@pytest.mark.parametrize("away", [0.3, 2.0])
@pytest.mark.parametrize("flow", [(0.0, 0.04), (0.0, -0.04), (0.05, 0.0)])
@pytest.mark.parametrize("thrust", [1.0, 0.5])
def test_the_fewest_steps_in_a_current_are_the_first_after_which_the_goal_is_in_reach(
    away, flow, thrust
):
    chain, flow = straight(8), jnp.array(flow)
    target, means = chain.units.position + jnp.array([0.0, away]), Means(thrust, flow)
    fewest = int(fewest_steps(PHYSICS, chain, target, 0.05, 2000, means))
    slack = 0.05 + float(centroid_slack(PHYSICS, 8))

    def ahead(k):
        own = thrust * float(distance_covered(PHYSICS, 8, k))
        return own + float(flow[1] * drift(PHYSICS, k))

    assert ahead(fewest) >= away - slack - 1e-5
    assert all(ahead(k) < away - slack + 1e-5 for k in range(1, fewest))
    plain = int(fewest_steps(PHYSICS, chain, target, 0.05, 2000))
    assert (fewest > plain) == (thrust < 1 or float(flow[1]) < 0)


def test_against_water_that_is_faster_than_it_swims_a_chain_comes_nowhere():
    chain, speed = straight(8), float(cruising_speed(PHYSICS, 8))
    target = chain.units.position + jnp.array([0.0, 5.0])
    for share, there in ((0.9, True), (1.1, False)):
        means = Means(1.0, jnp.array([0.0, -share * speed]))
        fewest = int(fewest_steps(PHYSICS, chain, target, 0.05, 5000, means))
        assert (fewest < 5000) == there
        far = float(reachable(PHYSICS, chain, target, 5000, means, 5000))
        assert (far > 0.999) == there
    stirred = Means(0.0, None, 0.1)  # water that may help anywhere: no limit but its speed
    fewest = int(fewest_steps(PHYSICS, chain, target, 0.05, 5000, stirred))
    assert fewest == pytest.approx(5.0 / 0.1 / 0.1, rel=0.05)


def test_what_is_reachable_in_water_is_the_best_moment_before_the_limit():
    """Water that carries a chain without thrusters past its target."""
    chain = straight(8)
    target, means = chain.units.position + jnp.array([1.0, 0.0]), Means(0.0, jnp.array([0.1, 0.0]))
    assert float(reachable(PHYSICS, chain, target, 1000, means, 1000)) == pytest.approx(1.0)
    left = 1.0 - 0.1 * float(drift(PHYSICS, 50)) - float(centroid_slack(PHYSICS, 8))
    short = reachable(PHYSICS, chain, target, 50, means, 1000)
    assert float(short) == pytest.approx(1 - left, abs=1e-4)
