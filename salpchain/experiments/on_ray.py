"""Jobs as Ray tasks, on one machine or on a cluster whose nodes share their folder.

A task of Ray runs the same process as `local` does, so that a job that crashes takes no worker with
it. Ray starts a task again when its worker or node dies; its job goes on from what it had saved.
"""

import logging
import os
import socket
from typing import Any

from salpchain.errors import InputError
from salpchain.experiments import process
from salpchain.experiments.job import Job
from salpchain.experiments.sweep import RETRIES, End
from salpchain.installation import install_command

try:
    import ray
    from ray.exceptions import RayError
except ImportError:
    ray = None

ANSWERS_WITHIN = 5.0  # s (chosen)
MANY = 10**6  # jobs at a time: Ray starts them when there is room


class RayExecutor:
    """As many jobs at a time as the cluster has room for, or as are asked for.

    Each takes `cpus` cores, over which it shares out its chains, and `gpus` of a GPU.

    Raises:
        InputError: Ray is missing, no cluster is at the address, or none of its nodes has as much
            as a job takes.
    """

    def __init__(
        self, address: str = "", jobs: int | None = None, cpus: int = 1, gpus: float = 0.0
    ) -> None:
        if ray is None:
            raise InputError(f"Ray is missing: run {install_command('cluster')}")
        self.jobs, self.cpus, self.gpus = jobs, cpus, gpus
        self._tasks: dict[Any, Job] = {}
        _join(address)
        _check_room(cpus, gpus)

    @property
    def room(self) -> int:
        """How many more jobs may be handed to Ray."""
        return (self.jobs or MANY) - len(self._tasks)

    def start(self, job: Job) -> None:
        """Hands a job to Ray."""
        options = {"num_cpus": self.cpus, "num_gpus": self.gpus, "max_retries": RETRIES}
        devices = None if self.gpus else self.cpus
        remote = ray.remote(**options)(_run)  # type: ignore[union-attr]
        self._tasks[remote.remote(job, devices, self.gpus)] = job

    def ended(self) -> dict[str, End]:
        """The jobs that have ended since the last call, by their labels."""
        if not self._tasks:
            return {}
        over, _ = ray.wait(list(self._tasks), num_returns=len(self._tasks), timeout=0)  # type: ignore[union-attr]
        return {self._tasks[handle].label: self._end(handle) for handle in over}

    def _end(self, handle: Any) -> End:
        job = self._tasks.pop(handle)
        try:
            status: Any = ray.get(handle)  # type: ignore[union-attr]
        except RayError as error:
            return End(False, retry=True, message=_first_line(error))
        return process.end_of(job, status)

    def stop(self) -> None:
        """Asks all to save and stop, and waits until they have."""
        handles = list(self._tasks)
        for handle in handles:
            ray.cancel(handle)  # type: ignore[union-attr]
        if handles:
            ray.wait(handles, num_returns=len(handles))  # type: ignore[union-attr]
        self._tasks.clear()
        ray.shutdown()  # type: ignore[union-attr]


def _join(address: str) -> None:
    """Connects, or starts a cluster on this machine where there is no address."""
    logging.getLogger("ray").setLevel(logging.ERROR)
    _check_answers(address or os.environ.get("RAY_ADDRESS", ""))
    try:
        ray.init(address=address or None, log_to_driver=False)  # type: ignore[union-attr]
    except (ConnectionError, ValueError, RuntimeError) as error:
        raise _none_at(address, error) from None


def _check_answers(address: str) -> None:
    """Ray would try for minutes to reach a host that does not answer."""
    host, colon, port = address.rpartition("://")[2].rpartition(":")
    if not colon:
        return  # Ray's own words: nothing, `auto`, `local`
    if not (port.isascii() and port.isdigit()):
        raise InputError(f"the address of a Ray cluster is HOST:PORT, got {address}")
    try:
        socket.create_connection((host, int(port)), timeout=ANSWERS_WITHIN).close()
    except (OSError, OverflowError) as error:
        raise _none_at(address, error) from None


def _none_at(address: str, error: Exception) -> InputError:
    return InputError(
        f"no Ray cluster at {address or 'RAY_ADDRESS'} ({_first_line(error)}): start one with"
        " `ray start --head`, or leave --address out"
    )


def _check_room(cpus: int, gpus: float) -> None:
    """Ray would wait for ever for a node that has this much."""
    nodes = [node["Resources"] for node in ray.nodes() if node["Alive"]]  # type: ignore[union-attr]
    if not any(node.get("CPU", 0) >= cpus and node.get("GPU", 0) >= gpus for node in nodes):
        most = {name: max(node.get(name, 0) for node in nodes) for name in ("CPU", "GPU")}
        raise InputError(
            f"no node of the Ray cluster has {cpus} CPUs and {gpus:g} GPUs: the largest have"
            f" {most['CPU']:g} and {most['GPU']:g}"
        )


def _first_line(error: Exception) -> str:
    return str(error).strip().split("\n")[0]


def _run(job: Job, devices: int | None, gpus: float) -> int:
    """Runs the job's process to its end; an interrupt is passed on, and waited for."""
    running = process.start(job, devices, process.gpu_share(gpus))
    try:
        return running.wait()
    except KeyboardInterrupt:
        running.send_signal(2)
        return running.wait()
