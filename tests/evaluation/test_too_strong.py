"""Where the water may be faster than any chain, the user is told before the work begins."""

from dataclasses import replace

import pytest

from salpchain.evaluation.too_strong import of_water
from salpchain.ranges import as_range
from salpchain.world.config import CurrentConfig, WorldConfig
from salpchain.world.presets import WORLDS


def test_in_our_own_worlds_every_chain_can_hold_its_target():
    assert [name for name, world in WORLDS.items() if of_water(world, [2, 512])] == []


@pytest.mark.parametrize(
    ("current", "told"),
    [
        ({"speed": "0:0.5"}, "may flow at 0.50 m/s, 64 units swim at 0.1"),
        ({"vortex": 0.15, "speed": 0.15}, "may flow at 0.30 m/s, 64 units"),
        ({"wander": 0.1}, "may flow at 0.30 m/s, 64 units"),
        ({"speed": 0.1}, ""),
    ],
)
def test_water_that_is_too_fast_is_named_with_the_slowest_chain(current, told):
    kinds = {name: as_range(value) for name, value in current.items()}
    line = of_water(replace(WorldConfig(), current=CurrentConfig(**kinds)), [8, 64, 4])
    assert told in line and bool(line) == bool(told) and "\n" not in line
