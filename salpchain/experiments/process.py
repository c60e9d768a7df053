"""The process that does a job, wherever it is started: here, or by a Ray task on some node."""

import os
import signal
import subprocess
import sys
from pathlib import Path

from salpchain import compilation_cache
from salpchain.experiments.job import Job
from salpchain.experiments.sweep import End

CACHE = "cache"  # folder of compiled programs, which the jobs of a folder share
MEMORY = 0.9  # of its share of a GPU that a process takes (chosen)


def start(job: Job, devices: int | None, extra: dict[str, str] | None = None) -> subprocess.Popen:
    """A process that does what is left of a job; what it prints goes to a file of its own.

    `devices`: over how many its chains are shared out, None for as many as there are. `extra`: of
    its environment.
    """
    log = _log(job)
    log.parent.mkdir(parents=True, exist_ok=True)
    own = compilation_cache.is_off() or compilation_cache.set_by_user()
    cache = {} if own else {compilation_cache.JAX_FOLDER: str(job.folder / CACHE)}
    environment = {**os.environ, **cache, **(extra or {})}
    with log.open("wb") as file:
        return subprocess.Popen(
            [sys.executable, *job.command(devices)],
            stdout=file, stderr=file, env=environment, start_new_session=True,
        )  # fmt: skip


def gpu_share(share: float) -> dict[str, str]:
    """For `start`: memory for a process that has this share of a GPU; nothing if it has none."""
    return {"XLA_PYTHON_CLIENT_MEM_FRACTION": f"{MEMORY * share:.2f}"} if 0 < share < 1 else {}


def end_of(job: Job, status: int) -> End:
    """How a process with this exit status ended, with the last line that it printed."""
    if status < 0:
        return End(False, retry=True, message=f"killed by {signal.Signals(-status).name}")
    try:
        lines = _log(job).read_text(errors="replace").strip().splitlines()
    except FileNotFoundError:
        lines = []
    return End(status == 0, message=lines[-1] if lines else f"exit status {status}")


def _log(job: Job) -> Path:
    return job.folder / "logs" / f"{job.label}.txt"
