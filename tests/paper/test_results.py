"""What is whole is told from what is not, and what is damaged is set aside, by name."""

import json
import pickle
import shutil

import numpy as np
import pytest

from salpchain.experiments.job import Job
from salpchain.files import write_arrays
from salpchain.paper.grid import Grid
from salpchain.paper.jobs import jobs_of
from salpchain.paper.results import (
    is_trained,
    run_of,
    set_damaged_aside,
    trained_share,
    untested,
)
from salpchain.training.run_folder import create

GRID = Grid(models=("gcn",), graphs=("mixed",), lengths=(8,), seeds=2, steps=40960, tests=(4,))
JOB, OTHER = GRID.jobs()
MEASURES = ("success", "closed_fraction", "final_distance", "reachable", "start_distance")


def evaluation_of(limit, length=4, trials=GRID.trials, **changed):
    """An evaluation.json of the study."""
    row = {"length": length, "trials": trials, **{key: {"mean": 0.5} for key in MEASURES}}
    return {"time_limit": limit, "lengths": [{**row, **changed}]}


@pytest.fixture
def study(tmp_path):
    """Two whole runs with their tests."""
    for job in (JOB, OTHER):
        run = run_of(tmp_path, job)
        create(run, job.config, devices=1, device="cpu")
        (run / "metrics.csv").write_text(log(job.config.iterations))
        for limit in job.tests:
            (run / limit).mkdir(parents=True)
            (run / limit / "evaluation.json").write_text(json.dumps(evaluation_of(limit)))
        (run / "summary.json").write_text(json.dumps({"steps": 1, "seconds": 1, "success": 1}))
        for kind in ("policy", "checkpoint"):
            header = {"iteration": job.config.iterations}
            write_arrays(run / f"{kind}.safetensors", kind, 1, header, {"w": np.ones(3)})
    return tmp_path


def log(rows):
    """A metrics.csv of so many iterations."""
    names = "iteration,steps,seconds,episodes,success,closed_fraction,reward_approach,reward_goal"
    lines = [f"{n},{4096 * n},{n},0,,,0,0" for n in range(1, rows + 1)]
    return "\n".join([names, *lines, ""])


def test_whole_results_are_left_alone(study):
    assert set_damaged_aside(study, GRID) == []
    assert is_trained(study, JOB) and not untested(study, JOB)


WEIGHTS = ("policy.safetensors", "checkpoint.safetensors")


@pytest.mark.parametrize("name", ["summary.json", "config.json", "metrics.csv", *WEIGHTS])
def test_a_run_with_a_damaged_file_is_set_aside_whole(study, name):
    run = run_of(study, JOB)
    if name in WEIGHTS:  # which a run needs until it is tested
        shutil.rmtree(run / "fixed")
    harmed = (run / name).read_bytes()[:-4]
    (run / name).write_bytes(harmed)
    [line] = set_damaged_aside(study, GRID)
    assert name in line and "seed-0.damaged" in line
    assert not is_trained(study, JOB) and untested(study, JOB) == ["fixed", "scaled"]
    assert (run.with_name("seed-0.damaged") / name).read_bytes() == harmed
    assert is_trained(study, OTHER) and set_damaged_aside(study, GRID) == []


def test_a_study_is_whole_without_the_weights_of_what_is_done(study):
    for path in study.rglob("*.safetensors"):
        path.write_bytes(b"damaged") if "policy" in path.name else path.unlink()
    assert set_damaged_aside(study, GRID) == []
    assert is_trained(study, JOB) and not untested(study, JOB)


@pytest.mark.parametrize("name", ["policy.safetensors", "config.json", "metrics.csv"])
def test_a_whole_run_that_lacks_a_file_that_its_tests_need_is_set_aside(study, name):
    (run_of(study, JOB) / name).unlink()
    (run_of(study, JOB) / "scaled" / "evaluation.json").unlink()
    [line] = set_damaged_aside(study, GRID)
    assert name in line and not is_trained(study, JOB) and is_trained(study, OTHER)


@pytest.mark.parametrize(
    "name, content",
    [
        ("config.json", "{}"),
        ("config.json", "[]"),
        ("metrics.csv", "not,a log\n1,2\n"),
        ("metrics.csv", log(3)),
        ("metrics.csv", log(20).replace("success", "wins")),
        ("summary.json", '{"steps": 3}'),
        ("summary.json", '{"steps": 3, "seconds": "abc", "success": 1}'),
    ],
)
def test_a_file_that_is_not_what_it_should_be_sets_its_run_aside(study, name, content):
    (run_of(study, JOB) / name).write_text(content)
    [line] = set_damaged_aside(study, GRID)
    assert name in line and not is_trained(study, JOB)


def test_a_run_with_other_settings_is_set_aside(study):
    run = run_of(study, JOB)
    shutil.copy(run_of(study, OTHER) / "config.json", run / "config.json")
    [line] = set_damaged_aside(study, GRID)
    assert "other settings" in line and not is_trained(study, JOB)


def test_a_run_that_was_interrupted_is_left_to_go_on_as_far_as_its_log_tells(study):
    run, half = run_of(study, JOB), JOB.config.iterations // 2
    (run / "summary.json").unlink()
    weights = {"w": np.ones(3)}
    write_arrays(run / "checkpoint.safetensors", "checkpoint", 1, {"iteration": half}, weights)
    (run / "metrics.csv").write_text(log(half + 1)[:-3])
    assert set_damaged_aside(study, GRID) == []
    (run / "metrics.csv").write_text(log(half - 1))
    [line] = set_damaged_aside(study, GRID)
    assert "metrics.csv" in line and not run.exists()


ODD_TESTS = (
    {},
    {"lengths": 3},
    {"lengths": []},
    evaluation_of("fixed"),
    evaluation_of("scaled", length=8),
    evaluation_of("scaled", trials=1),
    evaluation_of("scaled", success=0.5),
    evaluation_of("scaled", final_distance={"mean": None}),
)


@pytest.mark.parametrize("content", ["", *map(json.dumps, ODD_TESTS)])
def test_damaged_tests_are_set_aside_alone(study, content):
    place = run_of(study, JOB) / "scaled"
    (place / "evaluation.json").write_text(content)
    [line] = set_damaged_aside(study, GRID)
    assert "scaled" in line
    assert (place.with_name("scaled.damaged") / "evaluation.json").read_text() == content
    assert is_trained(study, JOB) and untested(study, JOB) == ["scaled"]


def test_a_folder_in_place_of_a_file_is_set_aside(study):
    place = run_of(study, JOB) / "scaled" / "evaluation.json"
    place.unlink()
    place.mkdir()
    [line] = set_damaged_aside(study, GRID)
    assert "scaled" in line and untested(study, JOB) == ["scaled"]


def test_the_jobs_of_a_study_know_what_is_done_and_what_does_the_rest(study):
    (study / "runs" / OTHER.name / "fixed" / "evaluation.json").unlink()
    first, second, baseline = jobs_of(study, GRID)
    assert (first.left(), second.left(), baseline.left()) == ([], [OTHER.name], ["greedy"])
    assert first.done() == pytest.approx(first.cost)
    assert 0 < second.done() < second.cost and baseline.done() == 0
    together, _ = jobs_of(study, GRID, together=True)
    assert (together.parts, together.left()) == ([JOB.name, OTHER.name], [OTHER.name])
    assert together.command(2) == ["-m", "salpchain.paper.job", str(study.resolve()), "0,1", "2"]
    assert isinstance(pickle.loads(pickle.dumps(together)), Job)


def test_damage_done_twice_overwrites_nothing(study):
    for _ in range(2):
        run = run_of(study, JOB)
        run.mkdir(exist_ok=True)
        (run / "summary.json").write_text("half")
        assert len(set_damaged_aside(study, GRID)) == 1
    assert sorted(p.name for p in run.parent.iterdir()) == [
        "seed-0.damaged", "seed-0.damaged1", "seed-1",
    ]  # fmt: skip


def test_the_share_of_a_training_is_that_of_its_last_whole_row(study):
    run = run_of(study, JOB)
    assert trained_share(study, JOB) == 1.0
    (run / "summary.json").unlink()
    assert trained_share(study, JOB) == 1.0
    (run / "metrics.csv").unlink()
    assert trained_share(study, JOB) == 0.0
    half = JOB.config.iterations // 2
    (run / "metrics.csv").write_text(f"iteration,steps\n{half - 1},1\n{half},1\n{half + 1},")
    assert trained_share(study, JOB) == pytest.approx(half / JOB.config.iterations)
