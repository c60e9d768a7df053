import re
from functools import partial
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pandas as pd
import pytest

from salpchain.controllers.approach import Approach
from salpchain.controllers.greedy import Greedy
from salpchain.evaluation import trials as module
from salpchain.evaluation.episodes import remember
from salpchain.evaluation.limits import reachable
from salpchain.evaluation.progress import telling
from salpchain.evaluation.recording import record
from salpchain.evaluation.starts import domain_for, start_keys
from salpchain.evaluation.trials import play, run_limits, run_trials
from salpchain.ranges import Range
from salpchain.tasks.config import ACTION_SIZES, TaskConfig
from salpchain.world.config import CurrentConfig, ThrusterConfig, WorldConfig
from tests.own import Constant

LENGTH, SEED, TRIALS = 4, 7, 16


@pytest.fixture(scope="module")
def greedy():
    return run_trials([Greedy()], LENGTH, TRIALS, "fixed", SEED)[0]


@pytest.fixture(scope="module")
def idle():
    return run_trials([Constant(0.0)], LENGTH, TRIALS, "fixed", SEED)[0]


ENV = domain_for([Greedy()], LENGTH, "fixed")


def begun(num):
    return module._begin(ENV, 1, LENGTH, SEED, jnp.arange(num))


def swum(crew, trials, until):
    return play(ENV, crew, trials, remember(crew, trials.state), jnp.int32(until))[0]


def test_there_is_a_row_for_each_trial_and_a_column_for_each_measure(greedy):
    assert list(greedy.trial) == list(range(TRIALS))
    assert set(greedy.columns) >= {
        *("policy", "length", "trial", "seed", "success", "closed_fraction", "final_distance"),
        *("start_distance", "steps_to_goal", "steps", "thrust_effort", "path_efficiency"),
        *(
            "contact_time",
            "reachable",
            "fewest_steps",
            "turn_steps",
            "regret",
            "time_ratio",
            "far",
            "turn",
            "bend",
        ),
    }
    assert greedy.success.dtype == bool
    assert greedy.isna().sum().drop(["steps_to_goal", "time_ratio"]).sum() == 0


def test_the_page_on_evaluations_says_what_every_column_is(greedy):
    page = (Path(__file__).parent.parent.parent / "docs" / "evaluate.md").read_text()
    rows = re.findall(r"^\| (`.*?) \|", page, re.MULTILINE)
    assert set(re.findall(r"`(\w+)`", " ".join(rows))) == set(greedy.columns)


def test_greedy_closes_more_than_doing_nothing_which_closes_nothing(greedy, idle):
    assert (idle.closed_fraction.abs() < 1e-6).all()
    assert greedy.closed_fraction.mean() > 0.5
    assert not idle.success.any() and (idle.steps == 512).all()
    assert (idle.thrust_effort == 0).all() and idle.path_efficiency.isna().all()


@pytest.mark.slow
def test_a_wider_goal_is_taken_sooner_and_farther_from_the_target(greedy):
    wide, *_ = run_trials([Greedy()], LENGTH, TRIALS, "fixed", SEED, task=TaskConfig(tolerance=0.2))
    np.testing.assert_array_equal(wide.start_distance, greedy.start_distance)
    assert wide.success.sum() > greedy.success.sum() and (wide.steps <= greedy.steps).all()
    assert (wide.fewest_steps < greedy.fewest_steps).all()
    last = wide[wide.success].final_distance
    assert (last < 0.21).all() and last.median() > 0.1


def test_every_policy_meets_the_same_starts(greedy, idle):
    np.testing.assert_array_equal(greedy.start_distance, idle.start_distance)
    np.testing.assert_array_equal(greedy.reachable, idle.reachable)


@pytest.mark.slow
def test_several_time_limits_in_one_go_measure_what_each_does_alone(monkeypatch):
    monkeypatch.setattr(module, "WORTH", 0)  # trials that have ended leave the batch early
    crew, length = [Constant(0.5), Greedy()], 20  # so long that the limits differ: 512 and 640
    both = run_limits(crew, length, 6, ("scaled", "fixed"), SEED)
    for limit in ("fixed", "scaled"):
        alone = run_trials(crew, length, 6, limit, SEED)
        for ours, theirs in zip(both[limit], alone, strict=True):
            pd.testing.assert_frame_equal(ours, theirs, rtol=1e-3)
    fixed, scaled = both["fixed"][0], both["scaled"][0]
    assert (fixed.steps == 512).all() and (scaled.steps == 640).all()
    assert (fixed.reachable <= scaled.reachable).all() and not fixed.equals(scaled)


def test_controllers_side_by_side_swim_as_each_does_alone():
    crew = (Constant(0.5), Greedy())
    start = module._begin(ENV, 2, LENGTH, SEED, jnp.arange(TRIALS))
    together = swum(crew, start, 15).state.chain.units.position
    for i, controller in enumerate(crew):
        alone = swum((controller,), begun(TRIALS), 15).state.chain.units.position
        np.testing.assert_allclose(together[:, i], alone[:, 0], atol=1e-4)
    assert float(jnp.abs(together[:, 0] - together[:, 1]).max()) > 0.05


def test_controllers_of_different_actions_are_refused():
    with pytest.raises(ValueError, match="share observation and action"):
        run_trials([Constant(0.0), Greedy(action="pair")], LENGTH, TRIALS, "fixed", SEED)


def test_greedy_thrusts_alike_in_either_action():
    states = begun(TRIALS).state
    moving = eqx.tree_at(lambda s: s.target, states, states.target + 0.3)
    alone = jax.tree.map(lambda x: x[:, 0], moving)
    thrusts = []
    for action in ACTION_SIZES:
        greedy = Greedy(action=action)
        env = domain_for([greedy], LENGTH, "fixed")
        actions = jax.vmap(greedy.act)(alone)
        assert actions.shape[-1] == ACTION_SIZES[action]
        thrusts.append(jax.vmap(env.thrust)(alone.chain, actions))
    assert float(jnp.abs(thrusts[0]).max()) > 0.1
    np.testing.assert_allclose(thrusts[0], thrusts[1])


def test_the_start_of_a_trial_depends_on_its_own_number_alone():
    keys = [jr.key_data(start_keys(SEED, LENGTH, jnp.arange(num))) for num in (3, 8)]
    np.testing.assert_array_equal(keys[0], keys[1][:3])
    mixed = np.random.default_rng(0).permutation(3 * TRIALS)[:TRIALS]
    one = begun(TRIALS)
    other = module._begin(ENV, 1, LENGTH, SEED, jnp.asarray(mixed))
    for number in set(mixed) & set(range(TRIALS)):
        place = list(mixed).index(number)
        for x, y in zip(leaves(one), leaves(other), strict=True):
            np.testing.assert_array_equal(x[number], y[place])


def test_each_seed_length_and_trial_has_a_start_of_its_own_that_training_never_sees():
    numbers = jnp.arange(50)
    keys = [start_keys(seed, length, numbers) for seed in (0, 1) for length in (4, 8)]
    training = [jr.split(jr.key(seed), 50) for seed in (0, 1)]
    drawn = np.concatenate([jr.key_data(k) for k in (*keys, *training)])
    assert len(np.unique(drawn, axis=0)) == len(drawn)


def test_a_trial_is_frozen_once_it_has_ended():
    half = swum((Greedy(),), begun(TRIALS), 200)
    whole = swum((Greedy(),), half, 512)
    over = np.asarray(half.state.done)
    assert over.any() and not over.all() and bool(whole.state.done.all())
    for x, y in zip(*map(leaves, (half, whole)), strict=True):
        np.testing.assert_array_equal(x[over], y[over])
    assert (np.asarray(half.state.time)[~over] == 200).all()


def leaves(trials):
    keyless = eqx.tree_at(lambda t: t.state.key, trials, jnp.zeros((TRIALS, 1)))
    return [np.asarray(x) for x in jax.tree.leaves(keyless)]


def test_success_is_the_goal_and_its_steps_those_played(greedy):
    assert greedy.success.any() and not greedy.success.all()
    reached, missed = greedy[greedy.success], greedy[~greedy.success]
    assert (reached.steps_to_goal == reached.steps).all()
    assert missed.steps_to_goal.isna().all() and (missed.steps == 512).all()
    closed = 1 - greedy.final_distance / greedy.start_distance
    np.testing.assert_allclose(greedy.closed_fraction, closed)
    assert (reached.final_distance <= 0.0513).all()


def test_effort_is_thrust_times_time_and_a_straight_way_is_efficient():
    (frame,) = run_trials([Constant(0.5)], LENGTH, TRIALS, "fixed", SEED)
    np.testing.assert_allclose(frame.thrust_effort, 0.5 * 0.1 * frame.steps, rtol=1e-4)
    np.testing.assert_allclose(frame.path_efficiency, 1.0, atol=1e-3)
    assert (frame.contact_time == 0).all()


def test_efficiency_is_a_share(greedy):
    assert greedy.path_efficiency.between(0, 1 + 1e-5).all()
    assert greedy.thrust_effort.between(0, 51.2).all()
    assert greedy.contact_time.between(0, 51.2).all()


@pytest.mark.parametrize("steps", [5, 20])
def test_no_swim_beats_the_physical_limit(steps):
    start = begun(TRIALS)
    bound = partial(reachable, ENV.physics, steps=steps)
    limits = jax.vmap(jax.vmap(lambda s: bound(s.chain, s.target)))(start.state)
    assert float(limits.max()) < 1
    for controller in (Greedy(), Constant(1.0), Constant(-1.0)):
        after = swum((controller,), start, steps).state
        assert bool((after.closed_fraction <= limits).all())


def test_no_trial_beats_the_physical_limit(greedy):
    assert (greedy.closed_fraction <= greedy.reachable).all()
    assert greedy.reachable.between(0, 1).all()


def test_no_success_is_faster_than_physics_allows(greedy):
    reached = greedy[greedy.success]
    assert (reached.time_ratio >= 1).all() and (reached.regret == 0).all()
    np.testing.assert_allclose(reached.time_ratio, reached.steps_to_goal / reached.fewest_steps)
    missed = greedy[~greedy.success]
    np.testing.assert_allclose(missed.regret, missed.reachable - missed.closed_fraction)
    assert (missed.regret > 0).all() and missed.time_ratio.isna().all()


def test_many_trials_are_played_in_blocks_with_the_same_results(monkeypatch, greedy):
    monkeypatch.setattr(module, "UNITS_AT_ONCE", TRIALS * LENGTH)
    told = []
    (blocks,) = run_trials([Greedy()], LENGTH, 2 * TRIALS - 1, "fixed", SEED, told.append)
    assert list(blocks.trial) == list(range(2 * TRIALS - 1))
    pd.testing.assert_frame_equal(blocks[:TRIALS], greedy)
    assert told == sorted(told) and told[-1] == 1.0


def told_of(work):
    """What is told of the work: shares and words."""
    told = []
    with telling(lambda *now: told.append(now), "greedy", "4 units") as tell:
        work(tell)
    return told


def test_compiling_is_told_before_the_first_step_and_only_when_it_is_done():
    def play_all(tell):
        run_trials([Greedy()], LENGTH, 11, "fixed", SEED, tell)  # as many as in no other test

    first, again = told_of(play_all), told_of(play_all)
    compiled = "greedy, compiling for 4 units"
    assert first[0] == (0.0, compiled)
    assert compiled not in [now for _, now in first[first.index((0.0, "greedy, 4 units")) :]]
    assert compiled not in [now for _, now in again]
    assert [told for told in first if told[1] != compiled] == again


def test_a_recording_tells_how_far_it_is_and_that_it_compiles():
    told = []
    record(Constant(0.0), [4, 5], "fixed", SEED, progress=lambda *now: told.append(now))
    shares, words = zip(*told, strict=True)
    assert list(shares) == sorted(shares) and shares[-1] == 1.0 and len(set(shares)) > 4
    assert words[0].startswith("constant, compiling for ")
    assert words[-1] == "constant, 4,5 units"


@pytest.mark.parametrize(
    ("trials", "length", "limit"), [(0, 4, "fixed"), (1, 1, "fixed"), (1, 4, "x")]
)
def test_impossible_trials_are_refused(trials, length, limit):
    with pytest.raises(ValueError):
        run_trials([Greedy()], length, trials, limit, SEED)


def test_a_recorded_swim_goes_from_the_start_of_its_trial_to_its_end(greedy):
    number = int(np.flatnonzero(greedy.success)[0])
    (swim,) = record(Greedy(), [LENGTH], "fixed", SEED, number)
    begin = begun(TRIALS).state
    first = begin.chain.units.position[number, 0, :LENGTH]
    np.testing.assert_allclose(swim.unit_position[0], first, atol=1e-6)
    np.testing.assert_allclose(swim.target, begin.target[number, 0, :LENGTH], atol=1e-6)
    assert swim.unit_position.shape == (len(swim.unit_angle), LENGTH, 2)
    assert np.abs(np.diff(swim.unit_position, axis=0)).max() < 0.1
    if swim.success:
        assert np.linalg.norm(swim.unit_position[-1] - swim.target, axis=-1).mean() <= 0.0513


def test_swims_of_many_lengths_recorded_together_are_those_recorded_alone():
    together = record(Greedy(), [3, 6], "fixed", SEED)
    for swim in together:
        (alone,) = record(Greedy(), [swim.length], "fixed", SEED)
        # not longer: joints that switch on and off make millimetres of the last digit in a second
        np.testing.assert_allclose(swim.unit_position[:8], alone.unit_position[:8], atol=1e-3)
        np.testing.assert_allclose(swim.target, alone.target, atol=1e-6)


@pytest.mark.slow
def test_trials_that_go_on_alone_end_as_they_do_among_all(monkeypatch):
    sizes = []

    def watched(env, crew, trials, *rest):
        sizes.append(len(trials.effort))
        return play(env, crew, trials, *rest)

    among_all = run_trials([Approach()], LENGTH, TRIALS, "fixed", SEED)[0]
    assert among_all.success.mean() > 0
    monkeypatch.setattr(module, "play", watched)
    monkeypatch.setattr(module, "REPORTS", 64)
    monkeypatch.setattr(module, "WORTH", 0)
    alone = run_trials([Approach()], LENGTH, TRIALS, "fixed", SEED)[0]
    assert sizes[0] == TRIALS
    assert sizes[-1] <= TRIALS / 4
    pd.testing.assert_frame_equal(alone, among_all, rtol=0.02)


STREAM = WorldConfig(current=CurrentConfig(speed=Range(0.05, 0.05)))
DEAD = WorldConfig(thrusters=ThrusterConfig(dead=Range(0.25, 0.25)))
SWIRL = WorldConfig(current=CurrentConfig(vortex=Range(0.05, 0.05)))
CHANGING = WorldConfig(current=CurrentConfig(wander=Range(0.02, 0.02)))


@pytest.mark.parametrize("world", [STREAM, DEAD, SWIRL])
def test_no_controller_beats_the_limits_of_its_own_world(greedy, world):
    (there,) = run_trials([Greedy()], LENGTH, TRIALS, "fixed", SEED, world=world)
    assert (there.closed_fraction <= there.reachable + 1e-6).all()
    reached = there[there.success]
    assert len(reached) > 0 and (reached.steps_to_goal >= reached.fewest_steps).all()
    assert there.possible.all() and not there.fewest_steps.equals(greedy.fewest_steps)


def test_nobody_knows_the_limits_of_water_that_changes_by_chance():
    (there,) = run_trials([Greedy()], LENGTH, 3, "fixed", SEED, world=CHANGING)
    unknown = there.loc[~there.success, ["reachable", "fewest_steps", "turn_steps", "regret"]]
    assert len(unknown) and unknown.isna().all(axis=None)
    assert there.possible.all()


@pytest.mark.slow
def test_what_physics_forbids_is_told_as_impossible():
    none = WorldConfig(thrusters=ThrusterConfig(dead=Range(1.0, 1.0)))
    (dead,) = run_trials([Greedy()], LENGTH, 3, "fixed", SEED, world=none)
    assert not dead.possible.any() and not dead.success.any()
    fast = WorldConfig(current=CurrentConfig(speed=Range(0.9, 0.9)))
    (swept,) = run_trials([Greedy()], LENGTH, 12, "fixed", SEED, world=fast)
    assert 0 < swept.possible.sum() < 12  # only who is swept towards the target
    assert not swept.success[~swept.possible].any()
