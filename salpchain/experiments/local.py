"""Jobs as processes on this machine."""

import signal
import subprocess

from salpchain.experiments import process
from salpchain.experiments.job import Job
from salpchain.experiments.sweep import End
from salpchain.machine import cores


class LocalExecutor:
    """As many processes as are asked for; each has its share of the cores, or of the GPUs."""

    def __init__(self, jobs: int, gpus: int = 0) -> None:
        self.jobs, self.gpus = jobs, gpus
        self.devices = None if gpus else max(1, cores() // jobs)
        self._processes: dict[str, subprocess.Popen] = {}  # by the label of the job, as all
        self._places: dict[str, int] = {}
        self._jobs: dict[str, Job] = {}

    @property
    def room(self) -> int:
        """How many more jobs may start now."""
        return self.jobs - len(self._processes)

    def start(self, job: Job) -> None:
        """Starts a process, in the first place that is free."""
        place = min(set(range(self.jobs)) - set(self._places.values()))
        extra = {}
        if self.gpus:
            share = process.gpu_share(self.gpus / max(self.jobs, self.gpus))
            extra = {"CUDA_VISIBLE_DEVICES": str(place % self.gpus), **share}
        self._places[job.label], self._jobs[job.label] = place, job
        self._processes[job.label] = process.start(job, self.devices, extra)

    def ended(self) -> dict[str, End]:
        """The jobs that have ended since the last call, by their labels."""
        over = {x: p.returncode for x, p in self._processes.items() if p.poll() is not None}
        for label in over:
            del self._processes[label], self._places[label]
        return {x: process.end_of(self._jobs.pop(x), status) for x, status in over.items()}

    def stop(self) -> None:
        """Asks all to save and stop, and waits until they have."""
        for running in self._processes.values():
            running.send_signal(signal.SIGINT)
        for running in self._processes.values():
            running.wait()
        self._processes.clear()
