"""Success in training, counted by when episodes began, against a naive count of all episodes."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from salpchain.devices import AXIS
from salpchain.training.cohorts import count, lag, no_cohorts
from salpchain.training.rollout import Outcome
from salpchain.training.run_log import Recent

ENVS, LENGTHS = 6, (2, 5)


def episodes_of_chains(limit, steps, rng):
    """(begin, end, success, length, scored) of every episode that `ENVS` chains live through."""
    for _ in range(ENVS):
        begin = 0
        while begin < steps:
            success = rng.random() < 0.6
            lasts = int(rng.integers(1, limit + 1)) if success else limit
            yield begin, begin + lasts - 1, success, int(rng.choice(LENGTHS)), rng.random() < 0.9
            begin += lasts


def outcomes_of(chains, rollouts, rollout):
    """What `collect` would give of these episodes, a record of (step, env) for each rollout."""
    steps = rollouts * rollout
    kinds = {"done": bool, "goal": bool, "time": int, "length": int, "is_scored": bool}
    table = {name: np.zeros((steps, ENVS), kind) for name, kind in kinds.items()}
    table["is_scored"][:] = True
    chain, last = -1, steps
    for begin, end, success, length, scored in chains:
        chain += begin == 0
        last = min(end, steps - 1)
        table["time"][begin : last + 1, chain] = np.arange(1, last - begin + 2)
        table["length"][begin : last + 1, chain] = length
        if end < steps:
            values = {"done": True, "goal": success, "is_scored": scored}
            for name, value in values.items():
                table[name][end, chain] = value
    for part in range(rollouts):
        own = {k: jnp.asarray(v[part * rollout : (part + 1) * rollout]) for k, v in table.items()}
        yield jax.vmap(jax.vmap(lambda values: _outcome(**values)))(own)


def _outcome(done, goal, time, length, is_scored):
    zero = jnp.zeros(())
    return Outcome(
        reward=zero,
        own=zero[None],
        terms={"approach": zero, "goal": zero, "fine": zero},
        terminated=goal,
        truncated=done & ~goal,
        goal=goal,
        is_scored=is_scored,
        final_value=zero,
        closed=0.5 * goal,
        metres=3.0 * goal,
        time=time,
        length=length,
    )


@pytest.mark.parametrize(("limit", "rollout"), [(7, 4), (4, 7), (8, 4), (5, 5), (1, 3), (9, 1)])
def test_each_cohort_is_every_episode_that_began_in_one_rollout(limit, rollout):
    rollouts = 12
    chains = list(episodes_of_chains(limit, rollouts * rollout, np.random.default_rng(limit)))
    counted = jax.jit(jax.vmap(partial(count, lengths=LENGTHS), axis_name=AXIS))
    cohorts = jax.tree.map(lambda x: x[None], no_cohorts(limit, rollout, len(LENGTHS)))
    for now, outcomes in enumerate(outcomes_of(chains, rollouts, rollout)):
        cohorts, whole = counted(cohorts, jax.tree.map(lambda x: x[None], outcomes))
        began = now - lag(limit, rollout)
        for i, length in enumerate(LENGTHS):
            own = [
                (success, end - begin + 1)
                for begin, end, success, of, scored in chains
                if begin // rollout == began and of == length and scored
            ]
            goals = sum(success for success, _ in own)
            assert float(whole.episodes[0, i]) == len(own)
            assert float(whole.goals[0, i]) == goals
            assert float(whole.lasted[0, i]) == sum(steps for _, steps in own)
            assert float(whole.closed[0, i]) == 0.5 * goals
            assert float(whole.returns[0, i]) == 4.0 * goals


@pytest.mark.parametrize(("limit", "rollout"), [(7, 4), (4, 7), (512, 32), (512, 512)])
def test_no_cohort_waits_longer_than_its_last_episode_may_take(limit, rollout):
    last_step = (rollout - 1) + (limit - 1)  # of an episode that begins at the end of its rollout
    assert lag(limit, rollout) == last_step // rollout


def rollout(episodes, success):
    return {"episodes": float(episodes), "success": success, "closed_fraction": success}


def test_success_is_that_of_the_latest_200_episodes():
    recent = Recent()
    for success in (0.0, 0.5, 1.0):
        recent.add(rollout(120, success))
    assert recent.means() == (0.75, 0.75)


def test_the_first_few_episodes_are_not_yet_a_success_rate():
    """The first to end are those that started beside their target."""
    recent = Recent()
    recent.add(rollout(199, 1.0))
    assert not recent.whole
    recent.add(rollout(1, 1.0))
    assert recent.whole


def test_before_any_episode_has_ended_there_is_no_rate():
    recent = Recent()
    recent.add(rollout(0, float("nan")))
    assert recent.means() == (None, None)
