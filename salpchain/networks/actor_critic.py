"""Actor and critic on a shared graph trunk (paper section 4.1)."""

from typing import Any, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from salpchain.errors import InputError
from salpchain.given import told
from salpchain.networks.config import MODELS, SINGLE_LENGTH, ControlConfig
from salpchain.networks.graph import GRAPHS, Graph
from salpchain.networks.layers import ACTOR_GAIN, WIDTH, Head, Recall, head, recall
from salpchain.networks.mlp import mlp
from salpchain.plugins import find
from salpchain.tasks.config import ACTION_SIZES
from salpchain.tasks.features import JETS, observation_size

Observation = Float[Array, "unit inputs"]
Known = Float[Array, "unit known"]  # what a critic of its own observes
Present = Bool[Array, " unit"]  # which slots hold a unit
Joined = Bool[Array, " link"]  # which links act
Action = Float[Array, "unit act"]
Memory = Float[Array, "unit 128"]  # what each unit remembers

START_LOG_STD = -0.5  # of every action


@runtime_checkable
class Trunk(Protocol):
    """A graph network: features of each unit from what all units observe."""

    def __call__(self, x: Float[Array, "unit inputs"], graph: Graph) -> Float[Array, "unit 128"]:
        """Features (unit, 128)."""
        ...


def trunk(key: PRNGKeyArray, config: ControlConfig, inputs: int) -> Trunk:
    """The graph network of these settings, with fresh weights.

    Raises:
        InputError: a model of one's own that is no graph network.
    """
    if config.model in MODELS:
        return find("model", MODELS[config.model].build)(key, inputs, config)
    return _own_trunk(key, config, inputs)


def _own_trunk(key: PRNGKeyArray, config: ControlConfig, inputs: int) -> Trunk:
    """A trunk of a user's own: a class of Equinox's modules, made with (key, inputs, config).

    Nothing else is called: a file names the model of its policy.
    """
    name = f"model {config.model}"
    kind: Any = find("model", config.model)
    if not (isinstance(kind, type) and issubclass(kind, eqx.Module)):
        raise InputError(f"{name} must be a class that is an equinox.Module, got {told(kind)}")
    units = GRAPHS["mixed"](jnp.ones(3, bool), jnp.ones(2, bool))
    make: Any = kind
    try:
        made = make(key, inputs, config)
        features = jax.eval_shape(made, jnp.zeros((3, inputs)), units)
    except Exception as error:
        said = " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(
            f"{name} must be made with (key, inputs, config) and called with what the units"
            f" observe (unit, inputs) and a graph: {said}"
        ) from error
    shape = getattr(features, "shape", None)
    if shape != (3, WIDTH):
        raise InputError(f"{name} must give features (unit, {WIDTH}), got {shape} of 3 units")
    return made


@runtime_checkable
class ActorCritic(Protocol):
    """A Gaussian over each unit's action, and the value of the whole chain."""

    @property
    def log_std(self) -> Any:
        """Of each action, (act,) or (slot, act)."""
        ...

    @property
    def critic_observes(self) -> str:
        """The observation that its critic needs besides; none if it needs none."""
        ...

    @property
    def recall(self) -> Any:
        """What its units remember with; None if they do not."""
        ...

    def __call__(
        self,
        obs: Observation,
        present: Present,
        joined: Joined,
        graph: Graph | None = None,
        known: Known | None = None,
    ) -> tuple[Action, Float[Array, ""]]:
        """Mean action of each unit, and the value; on another graph than its own if given.

        `known` is what its critic observes, if that is something of its own.
        """
        ...

    def act(
        self, obs: Observation, present: Present, joined: Joined, graph: Graph | None = None
    ) -> Action:
        """Mean action of each unit alone: what the deterministic policy does."""
        ...


class GraphActorCritic(eqx.Module):
    """Heads on a shared graph trunk; the same weights serve any length."""

    trunk: Trunk
    actor: Head
    critic: Head
    score: Head
    log_std: Float[Array, "*slots act"]
    graph: str = eqx.field(static=True)
    critic_trunk: Trunk | None = None
    critic_observes: str = eqx.field(default="", static=True)
    recall: Recall | None = None

    def __call__(
        self,
        obs: Observation,
        present: Present,
        joined: Joined,
        graph: Graph | None = None,
        known: Known | None = None,
    ) -> tuple[Action, Float[Array, ""]]:
        """Mean action of each unit, and the value; on another graph than its own if given.

        `known` is what the critic observes, where it has a trunk of its own.
        """
        return self.remember(obs, present, joined, None, graph, known)[:2]

    def remember(
        self,
        obs: Observation,
        present: Present,
        joined: Joined,
        memory: Memory | None,
        graph: Graph | None = None,
        known: Known | None = None,
    ) -> tuple[Action, Float[Array, ""], Memory | None]:
        """As when called, with what the units remember; and their memory after this step."""
        graph = graph or GRAPHS[self.graph](present, joined)
        features, after = self._features(obs, graph, memory)
        judged = features
        if self.critic_trunk is not None:
            assert known is not None
            judged = _on_graph(self.critic_trunk, known, graph)
        return self.actor(features), self.value(judged, present), after

    def act(
        self, obs: Observation, present: Present, joined: Joined, graph: Graph | None = None
    ) -> Action:
        """Mean action of each unit alone: what the deterministic policy does."""
        return self.plan(obs, present, joined, None, graph)[0]

    def plan(
        self,
        obs: Observation,
        present: Present,
        joined: Joined,
        memory: Memory | None,
        graph: Graph | None = None,
    ) -> tuple[Action, Memory | None]:
        """As `act`, with what the units remember; and their memory after this step."""
        graph = graph or GRAPHS[self.graph](present, joined)
        features, after = self._features(obs, graph, memory)
        return self.actor(features), after

    def _features(
        self, obs: Observation, graph: Graph, memory: Memory | None
    ) -> tuple[Float[Array, "unit 128"], Memory | None]:
        """What trunk and memory make of the observations; None where nothing is remembered."""
        features = _on_graph(self.trunk, obs, graph)
        if self.recall is None:
            return features, None
        return self.recall(features, jnp.zeros_like(features) if memory is None else memory)

    def value(self, features: Float[Array, "unit 128"], present: Present) -> Float[Array, ""]:
        """Value of the units' features, pooled by learned attention over the present units."""
        score = jnp.where(present, self.score(features)[:, 0], -jnp.inf)
        return self.critic(jax.nn.softmax(score) @ features)[0]


class ByJet(eqx.Module):
    """Two networks: a unit whose jet pushes one way acts by the second, every other by the first.

    A mixture of two experts (Jacobs et al. 1991) whose gate is not learned, for a unit knows what
    jet it has. Both hear the whole graph. A chain with a jet that pushes one way is judged by the
    second network. The spread of the actions in training is that of the first.
    """

    both_ways: GraphActorCritic
    one_way: GraphActorCritic

    @property
    def log_std(self) -> Any:
        """Of the actions of either, (act,) or (slot, act)."""
        return self.both_ways.log_std

    @property
    def critic_observes(self) -> str:
        """The observation that its critics need besides; none if they need none."""
        return self.both_ways.critic_observes

    @property
    def recall(self) -> None:
        """Its units remember nothing."""
        return None

    def __call__(
        self,
        obs: Observation,
        present: Present,
        joined: Joined,
        graph: Graph | None = None,
        known: Known | None = None,
    ) -> tuple[Action, Float[Array, ""]]:
        """Mean action of each unit, and the value; on another graph than its own if given."""
        two, one = (
            network(obs, present, joined, graph, known)
            for network in (self.both_ways, self.one_way)
        )
        pushes_one_way = _pushes_one_way(obs)
        action = jnp.where(pushes_one_way[:, None], one[0], two[0])
        return action, jnp.where((pushes_one_way & present).any(), one[1], two[1])

    def act(
        self, obs: Observation, present: Present, joined: Joined, graph: Graph | None = None
    ) -> Action:
        """Mean action of each unit alone: what the deterministic policy does."""
        two, one = (
            network.act(obs, present, joined, graph) for network in (self.both_ways, self.one_way)
        )
        return jnp.where(_pushes_one_way(obs)[:, None], one, two)


def _pushes_one_way(obs: Observation) -> Bool[Array, " unit"]:
    """Which units observe a jet of their own that pushes forwards and not backwards."""
    thruster, reverse = (obs[:, place] for place in JETS)
    return (thruster > 0) & (reverse <= 0)


def _on_graph(trunk: Trunk, obs: Observation, graph: Graph) -> Float[Array, "unit 128"]:
    """What a trunk makes of the observations; nodes that are no units observe nothing."""
    others = graph.nodes - len(obs)
    return trunk(jnp.pad(obs, ((0, others), (0, 0))), graph)[: len(obs)]


def actor_critic(
    key: PRNGKeyArray, config: ControlConfig, inputs: int, actions: int, length: int
) -> ActorCritic:
    """Fresh weights for units that observe `inputs` numbers and act with `actions`."""
    slots = () if config.shared_log_std else (length,)
    log_std = jnp.full((*slots, actions), START_LOG_STD)
    if config.model in SINGLE_LENGTH:
        return mlp(key, inputs, actions, length, log_std)
    if config.by_jet:
        each = (_graph_actor_critic(k, config, inputs, log_std) for k in jr.split(key))
        return ByJet(*each)
    return _graph_actor_critic(key, config, inputs, log_std)


def _graph_actor_critic(
    key: PRNGKeyArray, config: ControlConfig, inputs: int, log_std: Float[Array, "*slots act"]
) -> GraphActorCritic:
    """Heads on a trunk, with fresh weights."""
    actions = log_std.shape[-1]
    trunk_key, actor_key, critic_key, score_key = jr.split(key, 4)
    own = None
    if config.critic:
        own = trunk(jr.fold_in(trunk_key, 1), config, observation_size(config.critic))
    return GraphActorCritic(
        trunk=trunk(trunk_key, config, inputs),
        actor=head(actor_key, [WIDTH, WIDTH, WIDTH, actions], ACTOR_GAIN),
        critic=head(critic_key, [WIDTH, WIDTH, WIDTH, 1]),
        score=head(score_key, [WIDTH, WIDTH, 1]),
        log_std=log_std,
        graph=config.graph,
        critic_trunk=own,
        critic_observes=config.critic,
        recall=recall(jr.fold_in(trunk_key, 2)) if config.memory else None,
    )


def num_parameters(model: str, inputs: int, length: int) -> int:
    """Learnable numbers of a model as the paper counts them: action `pair`, a log-std for each.

    Args:
        model: name of the model.
        inputs: numbers that each unit observes.
        length: units in training.
    """
    config = ControlConfig(model=model, shared_log_std=False)
    actions = ACTION_SIZES["pair"]
    shapes = eqx.filter_eval_shape(actor_critic, jr.key(0), config, inputs, actions, length)
    return sum(leaf.size for leaf in jax.tree.leaves(shapes))
