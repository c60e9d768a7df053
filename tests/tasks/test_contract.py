"""A task of one's own that gives what it should not is named at its first use, with what would be
right."""

import jax
import jax.numpy as jnp
import pytest

from salpchain.errors import InputError
from salpchain.tasks.state import Judgement, Start
from tests.own import Hover, HoverConfig, Shapeless


class Rootless(Hover):
    """A task without a chain."""

    def begin(self, *given):
        return super().begin(*given).target


class Flat(Hover):
    """A task whose target is one point."""

    def begin(self, *given):
        return Start(super().begin(*given).chain, jnp.zeros(2))


class Far(Hover):
    """A task that moves its target to where no unit is."""

    def move(self, state):
        return jnp.zeros((3, 2)), None


class Forgetful(Hover):
    """A task that remembers something else later."""

    def move(self, state):
        return state.target, jnp.zeros(3)


class Alone(Hover):
    """A task that gives a target alone when it moves it."""

    def move(self, state):
        return state.target


class Careless(Hover):
    """A task whose reward has no weight."""

    def judge(self, before, after):
        return Judgement({"nearer": jnp.zeros(())}, False)


class Mute(Hover):
    """A task that judges by a number."""

    def judge(self, before, after):
        return jnp.zeros(())


WRONG = {
    Rootless: r"Rootless.begin must give a salpchain Start\(chain, target\), got .* of shape",
    Flat: r"Flat.begin: the target must have shape \(2, 2\) for 2 units, got \(2,\)",
    Far: r"Far.move: the target must have shape \(2, 2\) for 2 units, got \(3, 2\)",
    Forgetful: r"Forgetful.move must give a plan like that of begin, nothing, got float32\[3\]",
    Alone: "Alone.move must give a target and a plan, got",
    Careless: "Careless.judge must give the terms that have weights, near, got nearer",
    Shapeless: r"Shapeless.judge must give one number for near, got shape \(2,\)",
    Mute: r"Mute.judge must give a Judgement\(terms, ended\), got",
}


@pytest.mark.parametrize("task", WRONG, ids=lambda task: task.__name__)
def test_a_task_that_gives_what_it_should_not_is_named(task):
    env = task(HoverConfig(2, contact=False))

    def swim(key):
        return env.step(env.reset(key), jnp.zeros((2, 1)))

    with pytest.raises(InputError, match=WRONG[task]):
        jax.eval_shape(swim, jax.random.key(0))
