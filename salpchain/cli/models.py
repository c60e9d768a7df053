"""`salpchain models`."""

from dataclasses import dataclass

from salpchain.cli.options import Name, Whole, number
from salpchain.control.config import MODELS
from salpchain.domain.config import OBSERVATION_SIZES, check_length, one_of


@dataclass(frozen=True)
class Models:
    """List the controllers with their parameter counts.

    The paper's count of a model belongs to training length 8, the observation table1, two actions
    for each unit and one log-std for each action; that is what is counted here.

    Example: salpchain models --length 8
    """

    length: Whole = "8"
    """Training length, which sets the number of log-stds."""
    observation: Name = "table1"
    """table1 (the paper's) or body."""


def run(options: Models) -> None:
    """Prints a line for each model, and the greedy baseline."""
    length = check_length(number("length", options.length))
    one_of("observation", options.observation, OBSERVATION_SIZES)
    from salpchain.control.count import num_parameters

    inputs = OBSERVATION_SIZES[options.observation]
    print(f"{'model':<8} {'parameters':>10}   ({options.observation}, {length} units)")
    for model in MODELS:
        print(f"{model:<8} {num_parameters(model, inputs, length):>10,}")
    print(f"{'greedy':<8} {0:>10,}   hand-written, for any length")
