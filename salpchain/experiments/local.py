"""Jobs as processes on this machine."""

import signal
import subprocess
from pathlib import Path

from salpchain.experiments import process
from salpchain.experiments.sweep import End, Task
from salpchain.files import StrPath
from salpchain.machine import cores


class LocalExecutor:
    """As many processes as are asked for; each has its share of the cores, or of the GPUs."""

    def __init__(self, folder: StrPath, jobs: int, gpus: int = 0) -> None:
        self.folder, self.jobs, self.gpus = Path(folder), jobs, gpus
        self.devices = None if gpus else max(1, cores() // jobs)
        self._processes: dict[Task, subprocess.Popen] = {}
        self._places: dict[Task, int] = {}

    @property
    def room(self) -> int:
        """How many more tasks may start now."""
        return self.jobs - len(self._processes)

    def start(self, task: Task) -> None:
        """Starts a process, in the first place that is free."""
        place = min(set(range(self.jobs)) - set(self._places.values()))
        extra = {}
        if self.gpus:
            share = process.gpu_share(self.gpus / max(self.jobs, self.gpus))
            extra = {"CUDA_VISIBLE_DEVICES": str(place % self.gpus), **share}
        self._places[task] = place
        self._processes[task] = process.start(self.folder, task, self.devices, extra)

    def ended(self) -> dict[Task, End]:
        """The tasks that have ended since the last call."""
        over = {t: p.returncode for t, p in self._processes.items() if p.poll() is not None}
        for task in over:
            del self._processes[task], self._places[task]
        return {task: process.end_of(self.folder, task, status) for task, status in over.items()}

    def stop(self) -> None:
        """Asks all to save and stop, and waits until they have."""
        for running in self._processes.values():
            running.send_signal(signal.SIGINT)
        for running in self._processes.values():
            running.wait()
        self._processes.clear()
