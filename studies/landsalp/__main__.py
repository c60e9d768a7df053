"""Robots that exist: python -m studies.landsalp gait | search | water | long

gait    the gait that was published for LandSalp's three links: way, turn and bend of a cycle
search  gaits found by optimisation under the same jets, with joints to 10.4 and to 45 degrees
water   three links in water, identified on one measured run and held against the others
long    chains of 3 to 64 links under equal jets, on the ground and in water
"""

import sys
from collections.abc import Callable

import jax

from salpchain.devices import use_devices
from salpchain.errors import InputError
from studies import program
from studies.landsalp import chains, gaits

COMMANDS: dict[str, Callable[[], None]] = {
    "gait": gaits.published,
    "search": gaits.search,
    "water": chains.in_water,
    "long": chains.long,
}


def main() -> None:
    """Does what the command line names."""
    if len(sys.argv) != 2 or sys.argv[1] not in COMMANDS:
        raise InputError(f"name what to do: {', '.join(COMMANDS)}")
    use_devices(1)
    with jax.enable_x64(True):
        COMMANDS[sys.argv[1]]()


if __name__ == "__main__":
    program("landsalp", main, __doc__)
