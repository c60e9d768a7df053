"""Settings of a controller. Imports nothing heavy: the command line's help reads these classes."""

from dataclasses import dataclass
from typing import NamedTuple

from salpchain.checks import check_kinds, one_of
from salpchain.errors import InputError
from salpchain.given import told
from salpchain.plugins import check_known
from salpchain.tasks.features import check_observation, layout, readings


class Spec(NamedTuple):
    """A model of the package."""

    build: str  # module:function that makes it with fresh weights
    any_length: bool = True  # a trunk on the graph; else it works at its training length only


MODELS: dict[str, Spec] = {
    "gcn": Spec("salpchain.networks.gcn:gcn"),
    "gatv2": Spec("salpchain.networks.gatv2:gatv2"),
    "gt": Spec("salpchain.networks.gt:gt"),
    "mlp": Spec("salpchain.networks.mlp:mlp", any_length=False),
}
SINGLE_LENGTH = tuple(name for name, spec in MODELS.items() if not spec.any_length)
PAPER_GRAPHS: tuple[str, ...] = ("mixed", "full")
REACH = 4  # links that a unit hears far on `near` (chosen)
PAPER_DEPTH, DEEPEST = 2, 8  # graph layers


@dataclass(frozen=True)
class ControlConfig:
    """Which network steers the units.

    Raises:
        InputError: an unknown model, graph or observation of the critic; the message lists the
            known ones. `improved` for another model than gcn. A depth out of range, or of a model
            without graph layers; a critic's trunk of its own, memory or networks by jet for one
            without a trunk; both of the last two.
    """

    model: str = "gcn"  # one of `MODELS`, or a trunk of one's own as module:Class
    graph: str = "mixed"  # one of `salpchain.networks.graph.GRAPHS`
    shared_log_std: bool = True  # one for each kind of action; else one for each unit (the paper's)
    improved: bool = False  # gcn counts a unit's own features twice (PyG `GCNConv(improved=True)`)
    depth: int = PAPER_DEPTH  # graph layers; a unit hears as many links far
    # What a critic with a trunk of its own observes, of how things are and not as they are sensed
    # (asymmetric actor and critic, Pinto et al. 2018); none: the actor's trunk (the paper's).
    critic: str = ""
    memory: bool = False  # each unit remembers: a gated recurrent cell after the graph layers
    by_jet: bool = False  # a second network, by which units act whose jets push one way

    def __post_init__(self) -> None:
        check_kinds(self)
        check_known("model", self.model, MODELS)
        _check_graph(self.graph)
        if self.critic:
            _check_critic(self.critic, self.model)
        if self.memory and self.model in SINGLE_LENGTH:
            raise InputError(f"memory is of units on a graph: an {self.model} has none")
        if self.by_jet and (self.memory or self.model in SINGLE_LENGTH):
            has = "memory" if self.memory else f"model {self.model}"
            raise InputError(f"by_jet is of units on a graph that remember nothing, got {has}")
        if self.improved and self.model != "gcn":
            raise InputError(f"improved belongs to the model gcn, got model {self.model}")
        if not PAPER_DEPTH <= self.depth <= DEEPEST:
            raise InputError(f"depth must be {PAPER_DEPTH} to {DEEPEST} layers, got {self.depth}")
        if self.depth != PAPER_DEPTH and self.model in SINGLE_LENGTH:
            raise InputError(
                f"depth must stay {PAPER_DEPTH} for an {self.model}, which has no graph layers,"
                f" got {self.depth}"
            )


def check_jets(control: ControlConfig, observation: str) -> None:
    """Raise InputError if a unit that acts by its jet does not observe it."""
    if not control.by_jet:
        return
    wanted = layout("jets")
    if layout(observation)[: len(wanted)] != wanted:
        raise InputError(
            "control.by_jet needs an observation that begins as jets does, such as jets or sea, got"
            f" {observation}"
        )


def _check_critic(observed: str, model: str) -> None:
    try:
        check_observation(observed)
    except InputError as error:
        raise InputError(f"critic {told(observed)}: {error}") from None
    if readings(observed)[1] > 1:
        raise InputError(
            f"a critic sees how things are, not how they were: give {readings(observed)[0]}, got"
            f" critic {observed}"
        )
    if model in SINGLE_LENGTH:
        raise InputError(f"an {model} has no trunk of its own for a critic, got critic {observed}")


def _check_graph(name: object) -> None:
    if name not in PAPER_GRAPHS:  # the table of all needs JAX
        from salpchain.networks.graph import GRAPHS

        one_of("graph", name, GRAPHS)
