"""Settings of a controller. Imports nothing heavy: the command line's help reads these classes."""

from dataclasses import dataclass
from typing import Literal

from salpchain.domain.config import one_of

Model = Literal["gcn"]
GraphName = Literal["mixed", "full"]
MODELS: tuple[str, ...] = ("gcn",)
GRAPH_NAMES: tuple[str, ...] = ("mixed", "full")


@dataclass(frozen=True)
class ControlConfig:
    """Which network steers the units.

    Raises:
        InputError: an unknown model or graph; the message lists the known ones.
    """

    model: Model = "gcn"
    graph: GraphName = "mixed"
    shared_log_std: bool = True  # one for each kind of action; else one for each unit (the paper's)

    def __post_init__(self) -> None:
        one_of("model", self.model, MODELS)
        one_of("graph", self.graph, GRAPH_NAMES)
