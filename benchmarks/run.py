"""Speed against VMAS on the same machine, side by side in one run; the record goes to results/.

python -m benchmarks.run [--quick] [--name NAME]
"""

import argparse
import json
import os
import platform
from datetime import date
from importlib.metadata import version
from pathlib import Path
from typing import Any

import torch

from benchmarks.vmas_world import steps_per_second
from salpchain.evaluation.speed import Speed, best, measure
from salpchain.training.devices import device_name, use_devices

RESULTS = Path(__file__).parent / "results"
LENGTHS = (8, 16, 32, 64, 128)
VMAS_BATCHES = {8: (1024, 4096), 16: (512, 2048), 32: (512, 1024), 64: (256, 512), 128: (64, 256)}
OUR_BATCHES = {8: (512, 1024, 2048), 16: (256, 1024), 32: (128, 512), 64: (64, 256), 128: (64, 128)}


def machine() -> dict[str, Any]:
    """What the figures were measured on."""
    names = ("salpchain", "jax", "jaxlib", "torch", "vmas")
    cpu = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        lines = (line for line in info.read_text().splitlines() if line.startswith("model name"))
        cpu = next(lines, f": {cpu}").split(":")[1].strip()
    return {
        "cpu": cpu,
        "cores": len(os.sched_getaffinity(0)),
        "device": device_name(),
        "torch_threads": torch.get_num_threads(),
        "python": platform.python_version(),
        "versions": {name: version(name) for name in names},
        "date": date.today().isoformat(),
    }


def against_vmas(length: int, devices: int) -> dict[str, Any]:
    """Both engines at their own best batch size: ours as a whole environment, VMAS its world."""
    theirs = max((steps_per_second(n, length), n) for n in VMAS_BATCHES[length])
    environment = best("environment", length, OUR_BATCHES[length], devices)
    physics = measure("physics", length, environment.envs, devices)
    return {
        "length": length,
        "vmas_world_steps_per_second": theirs[0],
        "vmas_envs": theirs[1],
        "environment_steps_per_second": environment.steps_per_second,
        "physics_steps_per_second": physics.steps_per_second,
        "envs": environment.envs,
        "ratio_environment": environment.steps_per_second / theirs[0],
        "ratio_physics": physics.steps_per_second / theirs[0],
    }


def at_ten(devices: int) -> dict[str, Any]:
    """The original study's setting: 10 environments of 8 units."""
    theirs = steps_per_second(10, 8)
    ours = max((measure("environment", 8, 10, n) for n in {1, devices}), key=_rate)
    return {
        "vmas_world_steps_per_second": theirs,
        "environment_steps_per_second": ours.steps_per_second,
        "devices": ours.devices,
        "ratio_environment": ours.steps_per_second / theirs,
    }


def _rate(speed: Speed) -> float:
    return speed.steps_per_second


def scaling(devices: int) -> dict[str, Any]:
    """Cost per unit and step at 256 units against 8, at the same number of units in all."""
    short, long = (
        best("environment", n, b, devices) for n, b in ((8, (512, 1024)), (256, (32, 64)))
    )
    cost = {s.length: 1e9 * devices / (s.steps_per_second * s.length) for s in (short, long)}
    return {"core_ns_per_unit_step": cost, "ratio_256_to_8": cost[256] / cost[8]}


def contact_share(length: int, envs: int, devices: int) -> dict[str, Any]:
    """Share of the environment step that contact takes: chains under random thrust from rest."""
    with_contact = measure("environment", length, envs, devices)
    without = measure("environment without contact", length, envs, devices)
    share = 1 - with_contact.steps_per_second / without.steps_per_second
    return {"length": length, "envs": envs, "share_of_step": share}


def main() -> None:
    """Runs all comparisons, prints and writes them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="8 and 64 units only")
    parser.add_argument("--name", default="cpu", help="name of the record in results/")
    options = parser.parse_args()
    devices = use_devices()
    record: dict[str, Any] = {"machine": machine(), "devices": devices}
    record["ten_environments"] = at_ten(devices)
    print(json.dumps(record, indent=2), flush=True)
    record["against_vmas"] = []
    for length in (8, 64) if options.quick else LENGTHS:
        row = against_vmas(length, devices)
        print(json.dumps(row), flush=True)
        record["against_vmas"].append(row)
    record["scaling"] = scaling(devices)
    record["contact"] = [contact_share(8, 1024, devices), contact_share(64, 128, devices)]
    print(json.dumps({k: record[k] for k in ("scaling", "contact")}, indent=2))
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / f"speed-{options.name}.json").write_text(json.dumps(record, indent=2) + "\n")


if __name__ == "__main__":
    main()
