"""Robots that exist: python -m studies.landsalp NAME, one of

gait    the gait that was published for LandSalp's three links: way, turn and bend of a cycle
found   one that was found for the same period, jets and bend, the same way
glide   the fastest steady swims under the same jets, found among all shapes
search  gaits found by optimisation under the same jets, with joints to 10.4 and to 45 degrees
water   three links in water, identified on one measured run and held against the others
identify  the same with where their jets point identified, too, on two runs
long    chains of 3 to 64 links under equal jets, on the ground and in water
cost    processor time of a control step, beside that of the paper's chains
any-body  train one policy in all dynamics in turn, and test it in each
"""

import sys
from collections.abc import Callable

from salpchain.devices import use_devices
from salpchain.errors import InputError
from studies import program
from studies.landsalp import bodies, chains, gaits, identify

COMMANDS: dict[str, Callable[[], None]] = {
    "gait": gaits.published,
    "found": gaits.found,
    "glide": gaits.glides,
    "search": gaits.search,
    "water": chains.in_water,
    "identify": identify.identify,
    "long": chains.long,
    "cost": chains.cost,
    "any-body": bodies.any_body,
}


def main() -> None:
    """Does what the command line names."""
    if len(sys.argv) != 2 or sys.argv[1] not in COMMANDS:
        raise InputError(f"name what to do: {', '.join(COMMANDS)}")
    use_devices(1)
    COMMANDS[sys.argv[1]]()


if __name__ == "__main__":
    program("landsalp", main, __doc__)
