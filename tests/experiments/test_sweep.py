"""Jobs are started as there is room, tried again when their process died, and done once."""

import pytest

from salpchain.experiments import sweep as module
from salpchain.experiments.job import Job
from salpchain.experiments.local import LocalExecutor
from salpchain.experiments.sweep import RETRIES, End, sweep


class Note:
    """A job that is done when its parts have files; nothing of the package does it."""

    def __init__(self, folder, *parts):
        self.folder, self.parts, self.label = folder, parts, "+".join(parts).replace("/", "-")
        self.cost = 1000.0 * len(parts)

    def left(self):
        return [part for part in self.parts if not (self.folder / part).exists()]

    def done(self):
        return self.cost - 1000.0 * len(self.left())

    def command(self, devices):
        return ["-c", f"open({str(self.folder / self.parts[0])!r}, 'w')"]


def notes(folder):
    return [Note(folder, part) for part in "abcd"] + [Note(folder, "e", "f")]


class Pretender:
    """Does jobs at once, without a process; those named in `fate` end as it says first."""

    def __init__(self, room=1, fate=None):
        self.most, self.fate = room, fate or {}
        self.started, self.now, self.stopped = [], [], False
        self.busiest = 0

    @property
    def room(self):
        return self.most - len(self.now)

    def start(self, job):
        self.started.append(job.label)
        self.now.append(job)
        self.busiest = max(self.busiest, len(self.now))

    def ended(self):
        ends = {job.label: self._end(job) for job in self.now}
        self.now = []
        return ends

    def _end(self, job):
        if self.fate.get(job.label):
            return self.fate[job.label].pop(0)
        for part in job.parts:
            (job.folder / part).touch()
        return End(True)

    def stop(self):
        self.stopped = True


@pytest.fixture(autouse=True)
def at_once(monkeypatch):
    monkeypatch.setattr(module, "LOOK_EVERY", 0.0)


def test_all_jobs_are_done_and_nothing_is_done_twice(tmp_path):
    first = Pretender(room=2)
    seen = []
    assert sweep(notes(tmp_path), first, seen.append) == []
    assert sorted(first.started) == ["a", "b", "c", "d", "e+f"]
    assert first.busiest == 2 and first.stopped
    assert seen[-1].share == pytest.approx(1.0) and seen[-1].done == seen[-1].jobs == 6
    shares = [now.share for now in seen]
    assert shares == sorted(shares)
    again = Pretender()
    assert sweep(notes(tmp_path), again, lambda _: None) == []
    assert again.started == []


def test_time_left_goes_from_what_was_planned_to_the_pace_that_is_seen(tmp_path, monkeypatch):
    planned, needed, clock = 1000.0, 2000.0, [0.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: clock[0])

    class Slow(Pretender):
        def ended(self):
            clock[0] += needed
            return super().ended()

    seen = []
    sweep([Note(tmp_path, part) for part in "abcde"], Slow(), seen.append)
    left = {now.done: now.seconds_left for now in seen}
    assert 4 * planned < left[1] < 4 * needed
    assert left[4] == pytest.approx(needed, rel=0.05)


DIED = End(False, retry=True, message="killed by SIGKILL")


def test_a_job_whose_process_died_is_tried_again(tmp_path):
    executor = Pretender(fate={"b": [DIED] * RETRIES})
    assert sweep(notes(tmp_path), executor, lambda _: None) == []
    assert executor.started.count("b") == 1 + RETRIES


def test_a_job_that_keeps_dying_is_given_up_and_named_and_the_others_go_on(tmp_path):
    executor = Pretender(fate={"e+f": [DIED] * 99})
    (tmp_path / "e").touch()
    failures = sweep(notes(tmp_path), executor, lambda _: None)
    assert failures == ["f: killed by SIGKILL"]
    assert executor.started.count("e+f") == 1 + RETRIES
    assert set(executor.started) == {"a", "b", "c", "d", "e+f"}


def test_a_job_that_said_why_it_failed_is_not_tried_again(tmp_path):
    executor = Pretender(fate={"a": [End(False, message="not a finite number")]})
    failures = sweep(notes(tmp_path), executor, lambda _: None)
    assert failures == ["a: not a finite number"]
    assert executor.started.count("a") == 1


def test_an_interrupt_stops_the_jobs_too(tmp_path):
    executor = Pretender()

    def watch(_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sweep(notes(tmp_path), executor, watch)
    assert executor.stopped


def test_processes_of_this_machine_do_jobs_of_any_kind(tmp_path):
    jobs = [Note(tmp_path, part) for part in "ab"] + [Note(tmp_path, "c/d")]
    assert all(isinstance(job, Job) for job in jobs)
    (failure,) = sweep(jobs, LocalExecutor(jobs=2), lambda _: None)
    assert failure.startswith("c/d: FileNotFoundError")
    assert (tmp_path / "a").exists() and (tmp_path / "b").exists()
