"""Tasks are started as there is room, tried again when their process died, and done once."""

import json

import pytest

from salpchain.experiments import sweep as module
from salpchain.experiments.sweep import RETRIES, End, sweep
from salpchain.paper.grid import Grid
from salpchain.paper.results import run_of

GRID = Grid(models=("gcn",), graphs=("mixed", "full"), lengths=(8,), seeds=2, tests=(4,))


class Pretender:
    """Writes results without doing the work; tasks named in `fate` end as it says first."""

    def __init__(self, folder, room=1, fate=None):
        self.folder, self.most, self.fate = folder, room, fate or {}
        self.started, self.now, self.stopped = [], [], False
        self.busiest = 0

    @property
    def room(self):
        return self.most - len(self.now)

    def start(self, task):
        self.started.append(task)
        self.now.append(task)
        self.busiest = max(self.busiest, len(self.now))

    def ended(self):
        ends = {task: self._end(task) for task in self.now}
        self.now = []
        return ends

    def _end(self, task):
        if self.fate.get(task):
            return self.fate[task].pop(0)
        for number in task:
            self._do(number)
        return End(True)

    def _do(self, number):
        jobs = GRID.jobs()
        if number == len(jobs):
            places = [self.folder / "greedy" / limit for limit in GRID.time_limits]
        else:
            run = run_of(self.folder, jobs[number])
            run.mkdir(parents=True, exist_ok=True)
            (run / "summary.json").write_text("{}")
            places = [run / limit for limit in GRID.time_limits]
        for place in places:
            place.mkdir(parents=True, exist_ok=True)
            (place / "evaluation.json").write_text(json.dumps({"lengths": []}))

    def stop(self):
        self.stopped = True


@pytest.fixture(autouse=True)
def at_once(monkeypatch):
    monkeypatch.setattr(module, "LOOK_EVERY", 0.0)


def test_all_jobs_and_the_baseline_are_done_and_nothing_is_done_twice(tmp_path):
    first = Pretender(tmp_path, room=2)
    seen = []
    assert sweep(tmp_path, GRID, first, seen.append) == []
    assert sorted(first.started) == [(0,), (1,), (2,), (3,), (4,)]
    assert first.busiest == 2 and first.stopped
    assert seen[-1].share == pytest.approx(1.0) and seen[-1].done == seen[-1].jobs == 5
    shares = [now.share for now in seen]
    assert shares == sorted(shares)
    again = Pretender(tmp_path)
    assert sweep(tmp_path, GRID, again, lambda _: None) == []
    assert again.started == []


def test_time_left_goes_from_what_was_planned_to_the_pace_that_is_seen(tmp_path, monkeypatch):
    planned, needed, clock = 1000.0, 2000.0, [0.0]
    for name in ("_cost", "baseline_cost"):
        monkeypatch.setattr(module, name, lambda *_: planned)
    monkeypatch.setattr(module, "_done", lambda *job: planned * module.is_done(job[0], job[2]))
    monkeypatch.setattr(module.time, "monotonic", lambda: clock[0])

    class Slow(Pretender):
        def ended(self):
            clock[0] += needed
            return super().ended()

    seen = []
    sweep(tmp_path, GRID, Slow(tmp_path), seen.append)
    left = {now.done: now.seconds_left for now in seen}
    assert 4 * planned < left[1] < 4 * needed
    assert left[4] == pytest.approx(needed, rel=0.05)


def test_a_job_whose_process_died_is_tried_again(tmp_path):
    died = End(False, retry=True, message="killed by SIGKILL")
    executor = Pretender(tmp_path, fate={(1,): [died] * RETRIES})
    assert sweep(tmp_path, GRID, executor, lambda _: None) == []
    assert executor.started.count((1,)) == 1 + RETRIES


def test_a_job_that_keeps_dying_is_given_up_and_named_and_the_others_go_on(tmp_path):
    died = End(False, retry=True, message="killed by SIGKILL")
    executor = Pretender(tmp_path, fate={(1,): [died] * 99})
    failures = sweep(tmp_path, GRID, executor, lambda _: None)
    assert failures == ["gcn-full-8/seed-0: killed by SIGKILL"]
    assert executor.started.count((1,)) == 1 + RETRIES
    assert set(executor.started) == {(0,), (1,), (2,), (3,), (4,)}


def test_a_job_that_said_why_it_failed_is_not_tried_again(tmp_path):
    executor = Pretender(tmp_path, fate={(0,): [End(False, message="not a finite number")]})
    failures = sweep(tmp_path, GRID, executor, lambda _: None)
    assert failures == ["gcn-mixed-8/seed-0: not a finite number"]
    assert executor.started.count((0,)) == 1


def test_side_by_side_the_seeds_of_a_configuration_are_one_task(tmp_path):
    executor = Pretender(tmp_path)
    assert sweep(tmp_path, GRID, executor, lambda _: None, together=True) == []
    assert executor.started == [(0, 2), (1, 3), (4,)]


def test_an_interrupt_stops_the_jobs_too(tmp_path):
    executor = Pretender(tmp_path)

    def watch(_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sweep(tmp_path, GRID, executor, watch)
    assert executor.stopped
