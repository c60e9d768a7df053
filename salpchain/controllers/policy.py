"""What steers a chain: a learned policy or a hand-written controller, behind one interface."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import Any, Protocol, runtime_checkable

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from salpchain.checks import check_kinds, check_length, one_of, set_field
from salpchain.controllers.named import check_printable
from salpchain.errors import InputError
from salpchain.given import told, whole
from salpchain.networks.actor_critic import ActorCritic
from salpchain.networks.config import SINGLE_LENGTH, ControlConfig, check_jets
from salpchain.networks.graph import Graph, of_adjacency
from salpchain.networks.layers import WIDTH
from salpchain.switches import refused_if_sharded, standard_promotion
from salpchain.tasks.checks import check_state
from salpchain.tasks.config import ACTION_SIZES, PLAYED_LIMIT, TaskConfig
from salpchain.tasks.features import check_observation, observation_size
from salpchain.tasks.registry import check_task, config_class
from salpchain.tasks.state import State


@dataclass(frozen=True)
class PolicyCard:
    """What one must know to run a policy.

    Raises:
        InputError: a name that is no line of text; an unknown observation or action.
    """

    name: str = "gcn"
    control: ControlConfig = field(default_factory=ControlConfig)
    observation: str = "body"
    action: str = "thrust"
    length: int = 8  # units in training, the longest
    lengths: tuple[int, ...] = ()  # units in training, all
    steps: int = 0  # chain-steps of training
    world: str = "still"  # in which it was trained
    task_name: str = "reach"  # which it was trained for
    task_settings: tuple[tuple[str, Any], ...] = ()  # of that task alone, name and value

    def __post_init__(self) -> None:
        check_observation(self.observation)
        one_of("action", self.action, ACTION_SIZES)
        check_kinds(self)
        check_jets(self.control, self.observation)
        check_printable(self.name)
        check_task(self.task_name)
        if not _are_settings(self.task_settings):
            raise InputError(
                "task_settings must be pairs of a name and a value, such as (('speed', 0.1),), got"
                f" {told(self.task_settings)}"
            )
        set_field(self, "length", check_length(self.length))
        whole("steps", self.steps, least=0)

    def check_serves(self, length: int) -> None:
        """Raise InputError unless the policy can steer chains of this length."""
        check_length(length)
        if self.control.model in SINGLE_LENGTH and length != self.length:
            raise InputError(
                f"{self.name} is an {self.control.model} and works at {self.length} units only,"
                f" got length {length}"
            )

    @property
    def trained_for(self) -> TaskConfig:
        """The task that it was trained for, as it is where one is tested.

        Raises:
            InputError: that task is not there.
        """
        kind, own = config_class(self.task_name), dict(self.task_settings)
        gone = own.keys() - {field.name for field in fields(kind)}
        if gone:
            raise InputError(
                f"{self.name} was trained for {self.task_name} with {sorted(gone)[0]}, which that"
                " task no longer has: say which task is meant"
            )
        return kind(name=self.task_name, **own)

    def task(self, length: int, **settings: Any) -> TaskConfig:
        """The task at this length, with the observation and action that the policy speaks.

        Its time limit is the scaled one unless `time_limit` says otherwise.

        Raises:
            InputError: the policy cannot serve this length, or an invalid setting, that there
                is not, or that is not the policy's.
        """
        self.check_serves(length)
        spoken = {"length": int(length), "observation": self.observation, "action": self.action}
        for name, value in settings.items():
            one_of("setting of the task", name, [field.name for field in fields(TaskConfig)])
            if name in spoken and (not isinstance(value, str) or value != spoken[name]):
                raise InputError(f"{name} is {spoken[name]!r} for {self.name}, got {told(value)}")
        return TaskConfig(**{"time_limit": PLAYED_LIMIT, **settings, **spoken})

    def as_dict(self) -> dict[str, object]:
        """The card as plain JSON values."""
        return asdict(self)


def _are_settings(pairs: object) -> bool:
    """Whether these are names and values of settings."""
    return isinstance(pairs, tuple) and all(
        isinstance(pair, tuple) and len(pair) == 2 and isinstance(pair[0], str) for pair in pairs
    )


@runtime_checkable
class Controller(Protocol):
    """Anything that steers a chain."""

    @property
    def card(self) -> PolicyCard:
        """Its name, and the observation and action that it speaks."""
        ...

    def act(self, state: State) -> Float[Array, "unit act"]:
        """The action of every unit in this state; pure, for one chain."""
        ...


@runtime_checkable
class Planner(Controller, Protocol):
    """A controller that remembers: what it plans in one step serves the next."""

    def begin(self, state: State) -> Any:
        """Its memory before the first step of an episode."""
        ...

    def plan(self, state: State, memory: Any) -> tuple[Float[Array, "unit act"], Any]:
        """The action of every unit in this state, and the memory after it; pure, for one chain."""
        ...


def begin(controller: Controller, state: State) -> Any:
    """What the controller remembers before the first step; nothing unless it plans."""
    return controller.begin(state) if isinstance(controller, Planner) else ()


def act(controller: Controller, state: State, memory: Any) -> tuple[Float[Array, "unit act"], Any]:
    """The action of every unit, and what the controller remembers after it."""
    if isinstance(controller, Planner):
        return controller.plan(state, memory)
    return controller.act(state), memory


class Policy(eqx.Module):
    """A learned controller; acts with the mean of its distribution."""

    network: ActorCritic
    card: PolicyCard = eqx.field(static=True)

    @standard_promotion
    def act(
        self, state: State, graph: Graph | ArrayLike | Sequence | None = None
    ) -> Float[Array, "unit act"]:
        """Mean actions; on another graph than the policy's own if one is given.

        A graph is one of `salpchain.networks.graph`, or an (n, n) array of bool: who hears whom.

        Raises:
            InputError: a batch of states; a state with another observation than the policy's, or of
                a length that it cannot steer; a graph that is none, of another size than the chain,
                or for a policy that has none.
        """
        self._check(state, "act")
        chain = state.chain
        own = None if graph is None else self._graph(graph, slots=chain.present.shape[0])
        with refused_if_sharded("act"):
            return self.network.act(state.obs, chain.present, chain.joined, own)

    def _check(self, state: State, what: str) -> None:
        """Raise InputError unless it is the state of a chain that the policy can steer."""
        check_state(state, what)
        if state.obs.shape[-1] != observation_size(self.card.observation):
            raise InputError(
                f"{self.card.name} observes {self.card.observation}, the state has"
                f" {state.obs.shape[-1]} numbers for each unit: make it with card.task(length)"
            )
        self.card.check_serves(state.obs.shape[0])

    def _graph(self, graph: Graph | ArrayLike | Sequence, slots: int) -> Graph:
        """The graph, if it is one for this policy and this many slots."""
        if self.card.control.model in SINGLE_LENGTH:
            raise InputError(f"an {self.card.control.model} has no graph: give none")
        own = graph if isinstance(graph, Graph) else of_adjacency(graph)
        if own.nodes != slots:
            raise InputError(f"the graph has {own.nodes} nodes, the chain {slots} slots")
        return own


class RecurrentPolicy(Policy):
    """A learned controller whose units remember; `act` alone is its first step of an episode."""

    network: Any

    def begin(self, state: State) -> Float[Array, "unit 128"]:
        """What the units remember before the first step: nothing."""
        self._check(state, "begin")
        return jnp.zeros((state.obs.shape[0], WIDTH), state.obs.dtype)

    @standard_promotion
    def plan(
        self, state: State, memory: Float[Array, "unit 128"]
    ) -> tuple[Float[Array, "unit act"], Float[Array, "unit 128"]]:
        """Mean actions, and what the units remember after this step.

        Raises:
            InputError: as `act`.
        """
        self._check(state, "plan")
        chain = state.chain
        with refused_if_sharded("plan"):
            return self.network.plan(state.obs, chain.present, chain.joined, memory)


def as_policy(network: ActorCritic, card: PolicyCard) -> Policy:
    """The controller that this network makes."""
    return (RecurrentPolicy if card.control.memory else Policy)(network, card)
