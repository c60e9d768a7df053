import jax.numpy as jnp
import numpy as np

from salpchain.training.advantage import advantages, next_values


def naive(reward, value, following, terminated, truncated, gamma, lam):
    """The sum of discounted temporal differences up to the end of the episode, step by step."""
    steps, envs = reward.shape
    result = np.zeros((steps, envs))
    for e in range(envs):
        for t in range(steps):
            factor = 1.0
            for k in range(t, steps):
                after = 0.0 if terminated[k, e] else following[k, e]
                result[t, e] += factor * (reward[k, e] + gamma * after - value[k, e])
                if terminated[k, e] or truncated[k, e]:
                    break
                factor *= gamma * lam
    return result


def test_advantages_are_the_discounted_sums_within_each_episode():
    rng = np.random.default_rng(0)
    reward, value, following = rng.normal(size=(3, 30, 5)).astype(np.float32)
    terminated, truncated = rng.random((2, 30, 5)) < 0.1
    args = (reward, value, following, terminated, truncated)
    ours = advantages(*map(jnp.asarray, args), gamma=0.9, lam=0.8)
    np.testing.assert_allclose(ours, naive(*args, 0.9, 0.8), atol=1e-5)


def test_an_episode_out_of_time_is_worth_its_last_observation_a_reached_goal_nothing_more():
    value = jnp.array([[1.0, 1.0], [2.0, 2.0]])
    final = jnp.array([[7.0, 7.0], [0.0, 0.0]])
    truncated = jnp.array([[True, False], [False, False]])
    terminated = jnp.array([[False, True], [False, False]])
    following = next_values(value, jnp.array([3.0, 3.0]), final, truncated)
    gain = advantages(jnp.zeros((2, 2)), value, following, terminated, truncated, 0.5, 0.95)
    np.testing.assert_allclose(gain[0], [0.5 * 7 - 1, -1.0])
    np.testing.assert_allclose(gain[1], [0.5 * 3 - 2, 0.5 * 3 - 2])
