"""`salpchain bench`."""

from dataclasses import dataclass

from salpchain.cli.options import Lengths, Whole, positive
from salpchain.evaluation.config import parse_lengths


@dataclass(frozen=True)
class Bench:
    """Measure chain-steps per second of the physics and of the whole environment here.

    Compile time is apart; each figure is the median of five runs under random thrust. The
    comparison with VMAS is `make bench`.

    Example: salpchain bench --lengths 8,64 --envs 1024
    """

    lengths: Lengths = "8,64"
    """Lengths to measure."""
    envs: Whole = "1024"
    """Chains that swim at once."""


def run(options: Bench) -> None:
    """Prints a line for each measurement."""
    lengths, envs = parse_lengths(options.lengths), positive("envs", options.envs)
    from salpchain.devices import device_name, largest_divisor, use_devices
    from salpchain.evaluation.speed import PARTS, measure

    devices = largest_divisor(envs, use_devices())
    print(f"{device_name()}, {devices} device(s), {envs} chains at once")
    for length in lengths:
        for part in PARTS:
            speed = measure(part, length, envs, devices)
            rate = f"{speed.steps_per_second:>12,.0f} chain-steps/s"
            print(
                f"{length:>4} units  {part:<28} {rate}  compiled in {speed.compile_seconds:.1f} s"
            )
