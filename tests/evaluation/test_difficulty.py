import jax
import jax.random as jr
import numpy as np
import pytest

from salpchain.evaluation.difficulty import start_of
from salpchain.evaluation.limits import angle_turned
from salpchain.tasks.config import GOAL_LIMIT, TaskConfig
from salpchain.tasks.reach.targets import LINK
from salpchain.tasks.reach.task import SCLD


@pytest.mark.parametrize(("length", "slots"), [(2, 2), (5, 8), (12, 12)])
def test_how_hard_a_start_is_by_naive_reference(length, slots):
    env = SCLD(TaskConfig(length=slots, contact=False))
    keys = jr.split(jr.key(0), 20)
    states = jax.jit(jax.vmap(lambda key: env.reset(key, length)))(keys)
    starts = jax.jit(jax.vmap(lambda state: start_of(env, state)))(states)
    for index in range(20):
        position = np.asarray(states.chain.units.position[index, :length], np.float64)
        target = np.asarray(states.target[index, :length], np.float64)
        mean = np.linalg.norm(target - position, axis=1).mean()
        assert float(starts.far[index]) == pytest.approx(mean / (length * LINK), rel=1e-4)
        np.testing.assert_allclose(starts.origin[index], position.mean(axis=0), atol=1e-5)
        one, other = position[-1] - position[0], target[-1] - target[0]
        cosine = one @ other / np.linalg.norm(one) / np.linalg.norm(other)
        assert np.cos(float(starts.turn[index])) == pytest.approx(cosine, abs=1e-3)
        steps, half = int(starts.turn_steps[index]), np.linalg.norm(one) / 2
        ends_off = [
            2 * half * np.sin(max(np.arccos(cosine) - angle_turned(env.physics, length, k), 0) / 2)
            for k in (steps - 1, steps)  # the ends lie on a circle about the chain's middle
        ]
        assert ends_off[1] <= GOAL_LIMIT + 1e-3
        assert steps == 1 or ends_off[0] > GOAL_LIMIT - 1e-3
        angle = np.unwrap(np.arctan2(*np.diff(target, axis=0).T[::-1]))
        assert float(starts.bend[index]) == pytest.approx(np.abs(np.diff(angle)).sum(), abs=1e-3)
