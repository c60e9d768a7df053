"""What users write in modules of their own; tests name it as `tests.own:NAME`."""

from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from salpchain.controllers.policy import Controller, PolicyCard
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.features import OBSERVATIONS, minus, scalar_feature
from salpchain.tasks.reach.targets import draw, spawn
from salpchain.tasks.state import Judgement, Start, State
from salpchain.tasks.task import Task

SPEED = scalar_feature(
    "speed", "m/s", lambda view: view.root(view.velocity[0] ** 2 + view.velocity[1] ** 2)
)
FASTER = (*OBSERVATIONS["proximity"], SPEED)
NOT_FEATURES = ("speed", "place")
AHEAD = minus  # an object that is neither


@dataclass(frozen=True)
class HoverConfig(TaskConfig):
    """Settings of `Hover`."""

    softness: float = 0.05  # m


class Hover(Task):
    """Stay where you are."""

    config: HoverConfig = eqx.field(default_factory=HoverConfig, static=True)

    @property
    def weights(self):
        return {"near": 1.0}

    def begin(self, key, draw_key, length, physics):
        chain = spawn(draw(draw_key), self.config.length, length, physics)
        return Start(chain, chain.units.position)

    def judge(self, before, after):
        near = jnp.exp(-after.distances.mean / self.config.softness)
        return Judgement({"near": near}, jnp.zeros((), bool))

    def gauge(self, state):
        return {"drift": state.distances.mean}


class Shapeless(Hover):
    """A task whose reward is no number."""

    def judge(self, before, after):
        return Judgement({"near": after.chain.units.angle}, jnp.zeros((), bool))


class Deaf(eqx.Module):
    """A trunk in which no unit hears another."""

    layer: eqx.nn.Linear

    def __init__(self, key, inputs, config):
        self.layer = eqx.nn.Linear(inputs, 128, key=key)

    def __call__(self, x, graph):
        return jax.nn.relu(jax.vmap(self.layer)(x))


class Narrow(Deaf):
    """A trunk that gives too few features."""

    def __call__(self, x, graph):
        return super().__call__(x, graph)[:, :5]


class Spin:
    """A controller: all units push as hard as they can."""

    card = PolicyCard(name="spin")

    def act(self, state):
        return jnp.ones_like(state.thrust)[:, None]


class Demanding(Spin):
    """A controller that cannot be made without arguments."""

    def __init__(self, gain):
        self.gain = gain


class Constant(eqx.Module):
    """The same thrust on every unit, always; all such controllers share one compiled program."""

    thrust: Float[Array, ""] = eqx.field(converter=jnp.float32)

    @property
    def card(self) -> PolicyCard:
        """A controller of no settings."""
        return PolicyCard(name="constant")

    def act(self, state: State) -> Float[Array, "unit 1"]:
        """The constant."""
        return jnp.full((state.chain.present.shape[0], 1), self.thrust)


class Late(eqx.Module):
    """A controller that remembers: what another one does, a control step late."""

    controller: Controller

    @property
    def card(self) -> PolicyCard:
        """The other's."""
        return self.controller.card

    def begin(self, state):
        return jnp.zeros((state.chain.present.shape[0], 1))

    def plan(self, state, memory):
        return memory, self.controller.act(state)

    def act(self, state):
        return self.begin(state)
