"""Speed of the whole environment step in worlds against that in still water, in turn in one run.

python -m benchmarks.worlds [--name NAME] [--overwrite]

`four`: a current, dead thrusters, noise and delay together. The others are the named worlds.
"""

import argparse
import json

from benchmarks.run import add_options, begun
from salpchain.devices import use_devices
from salpchain.evaluation.speed import PAIRS, STILL, ratio
from salpchain.files import write_json
from salpchain.ranges import Range
from salpchain.world.config import CurrentConfig, SensingConfig, ThrusterConfig, WorldConfig
from salpchain.world.presets import WORLDS

LENGTH, ENVS = 8, 1024
FOUR = WorldConfig(
    current=CurrentConfig(speed=Range(0.0, 0.06)),
    thrusters=ThrusterConfig(dead=Range(0.0, 0.5)),
    sensing=SensingConfig(position=Range(0.0, 0.01), angle=Range(0.0, 0.1), delay=Range(0.0, 2.0)),
)
PART = "environment"


def main() -> None:
    """Measures, prints and writes the record."""
    parser = argparse.ArgumentParser(description=__doc__)
    add_options(parser)
    devices = use_devices()
    settings = {"length": LENGTH, "envs": ENVS, "devices": devices, "pairs": PAIRS}
    path, record = begun("worlds", parser.parse_args(), **settings)
    others = {name: world for name, world in WORLDS.items() if world != STILL}
    record["ratio"] = {
        name: ratio(PART, PART, LENGTH, ENVS, devices, (world, STILL))
        for name, world in {"four": FOUR, **others}.items()
    }
    write_json(path, record)
    print(json.dumps(record["ratio"], indent=2))


if __name__ == "__main__":
    main()
