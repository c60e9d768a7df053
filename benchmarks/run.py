"""Speed against VMAS on the same machine, side by side in one run; the record goes to results/.

python -m benchmarks.run [--quick] [--ours] [--name NAME] [--overwrite]

With --ours VMAS is left out, for machines without it; nothing is then a ratio.
"""

import argparse
import json
import platform
import sys
from collections.abc import Iterator
from datetime import date
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import jax

from salpchain.devices import device_name, use_devices
from salpchain.errors import InputError
from salpchain.evaluation.speed import Speed, best, measure, ratio
from salpchain.files import read_json, write_json
from salpchain.machine import cores, processor

HERE = "here"  # records of this name are of this machine, and not kept in the repository
RESULTS = Path(__file__).parent / "results"
LENGTHS = (8, 16, 32, 64, 128)
LISTS = ("best_batch", "contact")  # parts that have several rows
VMAS_BATCHES = {8: (1024, 4096), 16: (512, 2048), 32: (512, 1024), 64: (256, 512), 128: (64, 256)}


def machine() -> dict[str, Any]:
    """What the figures were measured on."""
    names = ("salpchain", "jax", "jaxlib", "torch", "vmas")
    return {
        "cpu": processor(),
        "cores": cores(),
        "device": device_name(),
        "python": platform.python_version(),
        "versions": {name: _version(name) for name in names},
        "date": date.today().isoformat(),
    }


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options that all benchmarks have: where the record goes."""
    parser.add_argument("--name", default=HERE, help=f"name of the record (default: {HERE})")
    parser.add_argument("--overwrite", action="store_true", help="replace any record of this name")


def begun(kind: str, options: argparse.Namespace, **settings: Any) -> tuple[Path, dict[str, Any]]:
    """Where the record goes, and what it begins with; ends the program where one is kept there.

    A record of the same machine and settings is replaced; another one only with --overwrite.
    """
    path = RESULTS / f"{kind}-{options.name}.json"
    record = {"machine": machine(), "settings": settings}
    if path.exists() and not options.overwrite:
        try:
            content = read_json(path)
        except InputError:
            content = None
        if not isinstance(content, dict) or _whose(content) != _whose(record):
            print(
                f"{path} is the record of another machine or of other settings: choose another"
                " --name, or add --overwrite",
                file=sys.stderr,
            )
            sys.exit(2)
    return path, record


def _whose(record: dict[str, Any]) -> tuple[Any, ...]:
    about = record.get("machine", {})
    return record.get("settings"), *(about.get(key) for key in ("cpu", "cores", "device"))


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


def at_best(length: int, devices: int, vmas: bool) -> dict[str, Any]:
    """Both engines at their own best batch size: ours as a whole environment, VMAS its world."""
    environment = best("environment", length, our_batches(length, devices), devices)
    physics = measure("physics", length, environment.envs, devices)
    ours = {
        "length": length,
        "envs": environment.envs,
        "environment_steps_per_second": environment.steps_per_second,
        "physics_steps_per_second": physics.steps_per_second,
    }
    return beside_vmas(ours, length, VMAS_BATCHES[length]) if vmas else ours


def at_ten(devices: int, vmas: bool) -> dict[str, Any]:
    """The original study's setting: 10 environments of 8 units."""
    speed = max((measure("environment", 8, 10, n) for n in {1, devices}), key=_rate)
    ours = {
        "length": 8,
        "envs": 10,
        "devices": speed.devices,
        "environment_steps_per_second": speed.steps_per_second,
    }
    return beside_vmas(ours, 8, (10,)) if vmas else ours


def our_batches(length: int, devices: int) -> tuple[int, ...]:
    """Batch sizes to try: on a CPU about what fits a core's cache, else as many as fill it."""
    units = (4096, 8192, 16384) if jax.default_backend() == "cpu" else (2**18, 2**20)
    return tuple(devices * max(1, n // length) for n in units)


def beside_vmas(ours: dict[str, Any], length: int, batches: tuple[int, ...]) -> dict[str, Any]:
    """The figures with VMAS's, at the best of these batch sizes, and the ratios of the speeds."""
    from benchmarks.vmas_world import steps_per_second

    rate, envs = max((steps_per_second(n, length), n) for n in batches)
    parts = [name for name in ours if name.endswith("_steps_per_second")]
    ratios = {f"ratio_{name.split('_')[0]}": ours[name] / rate for name in parts}
    return {**ours, "vmas_envs": envs, "vmas_world_steps_per_second": rate, **ratios}


def _rate(speed: Speed) -> float:
    return speed.steps_per_second


def scaling(devices: int) -> dict[str, Any]:
    """Cost per unit and step at 256 units against 8, either at its best batch size."""
    short, long = (
        best("environment", length, our_batches(length, devices), devices) for length in (8, 256)
    )
    cost = {s.length: 1e9 * devices / (s.steps_per_second * s.length) for s in (short, long)}
    return {"core_ns_per_unit_step": cost, "ratio_256_to_8": cost[256] / cost[8]}


def contact_share(length: int, envs: int, devices: int) -> dict[str, Any]:
    """Share of the environment step that contact takes: chains under random thrust from rest."""
    slower = ratio("environment", "environment without contact", length, envs, devices)
    return {"length": length, "envs": envs, "share_of_step": 1 - slower}


def parts(
    devices: int, vmas: bool, lengths: tuple[int, ...]
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Every comparison, with its name, as it is made."""
    yield "ten_environments", at_ten(devices, vmas)
    yield from (("best_batch", at_best(length, devices, vmas)) for length in lengths)
    yield "scaling", scaling(devices)
    yield from (("contact", contact_share(*sizes, devices)) for sizes in ((8, 2048), (64, 256)))


def main() -> None:
    """Runs all comparisons, prints and writes them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="8 and 64 units only")
    parser.add_argument("--ours", action="store_true", help="without VMAS")
    add_options(parser)
    options = parser.parse_args()
    devices, vmas = use_devices(), not options.ours
    path, record = begun("speed", options, quick=options.quick, ours=options.ours)
    record["devices"] = devices
    for part, row in parts(devices, vmas, (8, 64) if options.quick else LENGTHS):
        print(f"{part}: {json.dumps(row)}", flush=True)
        record[part] = [*record.get(part, []), row] if part in LISTS else row
        write_json(path, record)  # after each, so that a run cut short leaves what it saw


if __name__ == "__main__":
    main()
