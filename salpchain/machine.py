"""What this machine has room for."""

import os
import platform
import subprocess
import sys
from pathlib import Path

MEMORY = 1.5  # GiB that a job may take (chosen; the largest were seen to take 1.2)


def jobs_that_fit() -> int:
    """One for each core, as far as memory allows."""
    return max(1, min(cores(), int(_memory() // MEMORY)))


def gpus() -> int:
    """Accelerators that JAX sees; asked in a process of its own, which lets go of them again."""
    code = "import jax; print(jax.default_backend() != 'cpu' and jax.local_device_count() or 0)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return int(done.stdout)


def cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def processor() -> str:
    """What the processor calls itself, as far as the system tells."""
    return _cpuinfo("model name") or platform.processor() or platform.machine()


def instructions() -> str:
    """The instruction sets of the processor, as far as the system tells."""
    return _cpuinfo("flags") or _cpuinfo("Features") or platform.machine()


def _cpuinfo(name: str) -> str:
    """What Linux says of the first core under this name; else nothing."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    return next((line.partition(":")[2].strip() for line in lines if line.startswith(name)), "")


def _memory() -> float:
    """Total memory (GiB); practically unlimited if unknown."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    except (AttributeError, ValueError, OSError):
        return 1e6
