"""Worker processes: JAX does not survive a fork, so a forked worker is refused at once.

A fork copies one thread. Those that JAX has started are missing in the new process, and what waits
for them waits for ever.
"""

import os
import sys
from pathlib import Path

from salpchain.errors import InputError

REMEDY = (
    "JAX was started before this process was forked, and would wait here for ever: start workers"
    ' with spawn (AsyncVectorEnv(..., context="spawn"), SubprocVecEnv(..., start_method="spawn"),'
    ' multiprocessing.get_context("spawn")), or step many chains in one process with'
    ' gymnasium.make_vec("salpchain/SCLD-v0", num_envs=...)'
)


def check_not_forked() -> None:
    """Raise InputError in a process that was forked after JAX had started.

    Processes forked earlier, spawned ones, and programs started by one's own are left alone.

    Raises:
        InputError: JAX would hang here; the message says how to start workers.
    """
    if _state["broken"]:
        raise InputError(REMEDY)


def jax_started() -> bool:
    """Whether JAX has started its threads; without its lock, which a fork may leave taken."""
    return bool(getattr(sys.modules.get("jax._src.xla_bridge"), "_backends", None))


def _after_fork() -> None:
    """In the new process, before anything else runs there."""
    _state["broken"] = _state["broken"] or jax_started()


def _imported_too_late() -> bool:
    """Whether JAX had started and this process was forked before this module was imported.

    JAX has always threads of its own then, and a process that was just forked has one. Only Linux
    counts them.
    """
    threads = Path("/proc/self/task")
    return jax_started() and threads.is_dir() and len(list(threads.iterdir())) == 1


_state = {"broken": _imported_too_late()}

if hasattr(os, "register_at_fork"):  # not on Windows, which has no fork
    os.register_at_fork(after_in_child=_after_fork)
