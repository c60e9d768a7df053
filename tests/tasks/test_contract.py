"""A task of one's own that gives what it should not is named at its first use, with what would be
right."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import pytest

from salpchain.errors import InputError
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.reach.task import SCLD
from salpchain.tasks.registry import make_task
from salpchain.tasks.state import Judgement, Start
from salpchain.tasks.task import Task
from salpchain.training.trainer import train
from salpchain.world.obstacles import make_obstacles
from salpchain.world.world import World
from tests.own import Hover, HoverConfig, Shapeless
from tests.training.small import small


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


class Weightless(Task):
    """A task that says nothing of itself."""


class Endless(Weightless):
    """A task that begins, and is never judged."""

    @property
    def weights(self):
        return {}

    def begin(self, *given):
        return Hover.begin(self, *given)


class Raising(Hover):
    """A task with a slip in it."""

    def judge(self, before, after):
        return {}["near"]


class Nothing(Hover):
    """A task whose step gives nothing."""

    def step(self, state, action):
        return None


class Short(Hover):
    """A task whose step shows one unit alone."""

    def step(self, state, action):
        after = super().step(state, action)
        return eqx.tree_at(lambda s: s.obs, after, after.obs[:1])


class Long(Hover):
    """A task whose reset shows too little."""

    def reset(self, key, length=None):
        state = super().reset(key, length)
        return replace(state, obs=state.obs[:, :3])


class Triple(Hover):
    """A task with a reward for each of three judges."""

    def step(self, state, action):
        return eqx.tree_at(lambda s: s.reward, super().step(state, action), jnp.zeros(3))


class Generous(Hover):
    """A task with credit for more units than there are."""

    def credit(self, before, after):
        return jnp.zeros(9)


class Wide(Hover):
    """A task that reads a vector."""

    def gauge(self, state):
        return {"where": state.target[0]}


class Silent(Hover):
    """A task that reads nothing, and says so wrongly."""

    def gauge(self, state):
        return None


class Divided(Hover):
    """A task whose measure slips."""

    def measure(self, series):
        return {"share": 1 // 0}


class Counting(Hover):
    """A task whose term is whether something is so, and which says in Python that it goes on."""

    def judge(self, before, after):
        return Judgement({"near": after.distances.mean < 0.05}, False)


def test_a_term_may_be_a_whole_number_or_whether_something_is_so():
    env = make_task(HoverConfig(2, contact=False, name=f"{__name__}:Counting"))
    state = env.step(env.reset(jax.random.key(0)), jnp.zeros((2, 1)))
    assert state.terms["near"] == state.reward == 1.0 and state.reward.dtype == jnp.float32


WHOLE = {
    Weightless: "Weightless has no weights, how much each term of the reward counts: docs/",
    Endless: "Endless has no judge, what a step was worth: docs/recipes/task.md",
    Raising: r"Raising.step fails: KeyError: 'near'",
    Nothing: "Nothing.step must give a State, got None",
    Short: r"Short.step must give obs as float32\[2, 22\], got float32\[1, 22\]",
    Long: r"Long.reset must give obs as float32\[2, 22\], got float32\[2, 3\]",
    Triple: r"Triple.step must give reward as float32\[\], got float32\[3\]",
    Generous: r"Generous.credit must give a number for each unit, of shape \(2,\), got",
    Wide: r"Wide.gauge must give one number for where, got shape \(2,\)",
    Silent: "Silent.gauge must give a dict of numbers by name, got None",
    Divided: "Divided.measure fails: ZeroDivisionError",
}


@pytest.mark.parametrize("task", WHOLE, ids=lambda task: task.__name__)
def test_a_task_is_looked_at_as_a_whole_before_it_is_used(task):
    with pytest.raises(InputError, match=WHOLE[task]) as caught:
        make_task(HoverConfig(2, contact=False, name=f"{__name__}:{task.__name__}"))
    assert "\n" not in str(caught.value)


def test_a_training_that_is_refused_leaves_its_folder_free(tmp_path):
    config = replace(small(2), task=HoverConfig(2, name=f"{__name__}:Triple"))
    with pytest.raises(InputError, match=r"Triple\.step"):
        train(config, tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_an_episode_that_would_begin_in_a_wall_is_refused():
    wall = make_obstacles([((-5.0, 0.0), (5.0, 0.0), 3.0)])
    env = SCLD(TaskConfig(2, contact=False), World(obstacles=wall))
    with pytest.raises(InputError, match="wall 0 covers unit 0 at the start"):
        env.reset(jax.random.key(0))
    free = SCLD(TaskConfig(2, contact=False)).reset(jax.random.key(0))
    with pytest.raises(InputError, match="wall 0 covers unit 0 at the start"):
        env.start(free.chain, free.target, jax.random.key(0))
    jax.eval_shape(env.reset, jax.random.key(0))  # where nothing is known, nothing is refused


@pytest.mark.parametrize("task", WRONG, ids=lambda task: task.__name__)
def test_a_task_that_gives_what_it_should_not_is_named(task):
    env = task(HoverConfig(2, contact=False))

    def swim(key):
        return env.step(env.reset(key), jnp.zeros((2, 1)))

    with pytest.raises(InputError, match=WRONG[task]):
        jax.eval_shape(swim, jax.random.key(0))
