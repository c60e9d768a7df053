"""What a step makes of actions that cannot be: wrong shapes, NaN, infinity."""

import subprocess
import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

from salpchain.tasks.config import TaskConfig
from salpchain.tasks.reach.task import SCLD

ENV = SCLD(TaskConfig(length=4, observation="proximity"))
STEP = jax.jit(jax.vmap(ENV.step))


@pytest.fixture(scope="module")
def states():
    """Three chains that swim; the second has a dead slot."""
    states = jax.vmap(ENV.reset)(jr.split(jr.key(0), 3), jnp.array([4, 3, 4]))
    for key in jr.split(jr.key(1), 5):
        states = STEP(states, jr.uniform(key, (3, 4, 1), minval=-1.0))
    return states


def one_of(states, chain):
    return jax.tree.map(lambda x: x[chain], states)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_an_action_that_is_not_finite_ends_its_own_episode_alone(states, bad):
    action = jr.uniform(jr.key(2), (3, 4, 1), minval=-1.0)
    good, after = STEP(states, action), STEP(states, action.at[1, 2].set(bad))
    assert list(after.invalid) == [False, True, False] == list(after.terminated)
    assert not after.goal.any() and not after.truncated.any()
    for chain in (0, 2):
        assert eqx.tree_equal(one_of(after, chain), one_of(good, chain))
    ended, before = one_of(after, 1), one_of(states, 1)
    for bodies in ("units", "links"):
        now, then = getattr(ended.chain, bodies), getattr(before.chain, bodies)
        np.testing.assert_array_equal(now.position, then.position)
        np.testing.assert_array_equal(now.angle, then.angle)
    np.testing.assert_array_equal(ended.chain.present, before.chain.present)
    numbers = [x for x in jax.tree.leaves(ended) if jnp.issubdtype(x.dtype, jnp.floating)]
    assert all(jnp.isfinite(x).all() for x in numbers)
    assert float(ended.reward) == 0.0 and float(ended.closed_fraction) == pytest.approx(
        float(before.closed_fraction)
    )


def test_what_a_dead_slot_is_told_does_not_matter(states):
    action = jnp.zeros((3, 4, 1))
    after = STEP(states, action.at[1, 3].set(np.nan))
    assert not after.invalid.any()
    assert eqx.tree_equal(after, STEP(states, action))


# What users see: without the types that the tests check at run time.
REFUSED = {
    "env.step(state, jnp.zeros((1, 1)))": "action must have shape (4, 1)",
    "env.step(state, jnp.zeros(4))": "action must have shape (4, 1)",
    "env.step(state, jnp.zeros((4, 2)))": "action must have shape (4, 1)",
    "env.step(state, 0.5)": "action must have shape (4, 1)",
    "env.step(state, jnp.zeros((2, 4, 1)))": "got (2, 4, 1): for a batch, use jax.vmap(step)",
    "env.step(state, jnp.zeros((4, 1), complex))": "action must be real numbers",
    "env.step(states, jnp.zeros((4, 1)))": "use jax.vmap(step)",
    "salpchain.load('any-length').act(states)": "use jax.vmap(act)",
    "salpchain.Greedy().act(states)": "use jax.vmap(act)",
    "salpchain.Approach().act(states)": "use jax.vmap(act)",
    "env.reset(jax.random.split(key, 2))": "use jax.vmap(reset)",
    "env.reset(0)": "random key, such as jax.random.key(0), got 0",
    "env.reset(None)": "random key, such as jax.random.key(0), got None",
    "env.reset(jnp.zeros(2))": "got float32 of shape (2,)",
    "env.reset(key, 1)": "length must be 2 to 4 units here, got 1",
    "env.reset(key, 5)": "length must be 2 to 4 units here, got 5",
    "env.reset(key, 2.0)": "length must be one whole number",
    "env.reset(key, jnp.array([2, 3]))": "length must be one whole number",
    "env.reset(key, True)": "length must be",
    "env.start(longer.chain, longer.target, key)": "unit positions must have shape (4, 2)",
    "env.start(state.chain, longer.target, key)": "the target must have shape (4, 2)",
}
PROGRAM = """
import sys
import jax, jax.numpy as jnp, salpchain
key = jax.random.key(0)
env = salpchain.SCLD(salpchain.TaskConfig(length=4, observation="proximity"))
state = env.reset(key)
states = jax.vmap(env.reset)(jax.random.split(key, 2))
longer = salpchain.SCLD(salpchain.TaskConfig(length=5)).reset(key)
for line in sys.stdin.read().splitlines():
    try:
        print("done", eval(line) is None)
    except salpchain.InputError as error:
        print(str(error).replace("\\n", " "))
    except Exception as error:
        print("not refused but", repr(error).replace("\\n", " "))
"""


@pytest.fixture(scope="module")
def told():
    """What each of `REFUSED` is told."""
    words, lines = [sys.executable, "-c", PROGRAM], "\n".join(REFUSED)
    done = subprocess.run(words, input=lines, capture_output=True, text=True, check=True)
    return dict(zip(REFUSED, done.stdout.splitlines(), strict=True))


@pytest.mark.parametrize("call", REFUSED)
def test_what_cannot_be_is_refused_when_it_is_traced(call, told):
    assert REFUSED[call] in told[call]
