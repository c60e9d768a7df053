"""`salpchain bench`."""

from dataclasses import asdict, dataclass
from json import dumps
from typing import TYPE_CHECKING

from salpchain.cli.options import Flag, Lengths, Whole, World, positive
from salpchain.cli.streams import say
from salpchain.evaluation.config import parse_lengths
from salpchain.world.presets import world_config

if TYPE_CHECKING:
    from salpchain.evaluation.speed import Speed


@dataclass(frozen=True)
class Bench:
    """Measure chain-steps per second of the physics and of the whole environment here.

    Compile time is apart; each figure is the median of five runs under random thrust. The
    comparison with VMAS is `make bench`. In a world other than still water the whole environment
    alone is measured.

    Example: salpchain bench --lengths 8,64 --envs 1024
    """

    lengths: Lengths = "8,64"
    """Lengths to measure."""
    envs: Whole = "1024"
    """Chains that swim at once."""
    world: World = "still"
    json: Flag = False
    """Print the measurements as JSON alone."""


def run(options: Bench) -> None:
    """Prints a line for each measurement."""
    lengths, envs = parse_lengths(options.lengths), positive("envs", options.envs)
    world = world_config(options.world)
    from salpchain.devices import device_name, largest_divisor, use_devices
    from salpchain.evaluation.speed import PARTS, STILL, measure

    devices = largest_divisor(envs, use_devices())
    about = {"device": device_name(), "devices": devices, "envs": envs, "world": world.name}
    parts = [part for part in PARTS if world == STILL or part.startswith("environment")]
    if not options.json:
        print(f"{about['device']}, {devices} device(s), {envs} chains at once, world {world.name}")
    speeds = []
    for length in lengths:
        for part in parts:
            say(f"measuring {part}, {length} units: compiling")
            speeds.append(measure(part, length, envs, devices, world))
            if not options.json:
                print(_line(speeds[-1]), flush=True)
    if options.json:
        print(dumps({**about, "measurements": [asdict(speed) for speed in speeds]}, indent=2))


def _line(speed: "Speed") -> str:
    rate = f"{speed.steps_per_second:>12,.0f} chain-steps/s"
    compiled = f"compiled in {speed.compile_seconds:.1f} s"
    return f"{speed.length:>4} units  {speed.part:<28} {rate}  {compiled}"
