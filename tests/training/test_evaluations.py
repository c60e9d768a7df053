"""What a training tells: files and functions, against an evaluation and a loop of one's own."""

import csv
import dataclasses
import json

import pytest

import salpchain
from salpchain.controllers.storage import load
from salpchain.evaluation.evaluate import evaluate
from salpchain.training import evaluations
from salpchain.training.trainer import train
from tests.training.small import small

CONFIG = dataclasses.replace(small(6), evaluations=3)
TOLD = []


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run that ends before its first cohort is whole, evaluated three times."""
    folder = tmp_path_factory.mktemp("run") / "run"
    both = (lambda metrics, step: metrics.clear(), lambda *told: TOLD.append(told))
    train(CONFIG, folder, on_iteration=both, devices=1)
    return folder


def rows(path):
    return list(csv.DictReader(path.open()))


def test_the_success_of_a_run_is_what_evaluate_tells_of_it(run):
    summary = json.loads((run / "summary.json").read_text())
    length = small(6).task.length
    own = evaluate(load(run), [length], evaluations.TRIALS, "scaled", 0, baseline=False)
    assert summary["success"] == own["lengths"][0]["success"]["mean"]
    assert summary["closed_fraction"] == pytest.approx(
        own["lengths"][0]["closed_fraction"]["mean"], abs=1e-3
    )


def test_before_the_first_cohort_is_whole_it_is_too_early_to_tell(run):
    assert all(row["success"] == "" and row["episodes"] == "0" for row in rows(run / "metrics.csv"))
    summary = json.loads((run / "summary.json").read_text())
    assert summary["in_training"] == {"success": None, "closed_fraction": None}


def test_functions_are_told_what_the_files_say_without_what_is_too_early_to_tell(run):
    batch = small(6).ppo.batch
    assert [step // batch for _, step in TOLD] == [1, 2, 2, 3, 4, 4, 5, 6, 6]
    rollouts = [metrics for metrics, _ in TOLD if "iteration" in metrics]
    for metrics, row in zip(rollouts, rows(run / "metrics.csv"), strict=True):
        written = {name: float(cell) for name, cell in row.items() if cell}
        assert metrics == pytest.approx(written, rel=1e-6) and "update_value" in metrics
    tested = [metrics for metrics, _ in TOLD if "iteration" not in metrics]
    for metrics, row in zip(tested, rows(run / "evaluations.csv"), strict=True):
        assert metrics["evaluation_success"] == pytest.approx(float(row["success"]))
        assert len(metrics) == 2


def test_a_loop_of_ones_own_gives_what_train_gives_bit_for_bit(run, tmp_path):
    first = learner = salpchain.new_learner(CONFIG, devices=1)
    for row in rows(run / "metrics.csv"):
        learner, metrics = salpchain.iterate(learner)
        written = {name: float(cell) for name, cell in row.items() if cell and "second" not in name}
        assert metrics == pytest.approx(written, rel=1e-6)
    assert (first.steps, learner.steps) == (0, CONFIG.total_steps)
    salpchain.save_policy(learner.policy, tmp_path / "policy.safetensors")
    own, theirs = ((x / "policy.safetensors").read_bytes() for x in (tmp_path, run))
    assert own == theirs
    with pytest.raises(salpchain.InputError, match="made all 6 iterations"):
        salpchain.iterate(learner)
    again, _ = salpchain.iterate(first)  # it is as it was
    assert again.steps == CONFIG.ppo.batch and again.policy.card.steps == again.steps


def test_evaluations_on_the_way_are_evenly_spaced_and_the_last_is_the_closing_one(run):
    table = rows(run / "evaluations.csv")
    assert [row["iteration"] for row in table] == ["2", "4", "6"]
    summary = json.loads((run / "summary.json").read_text())
    assert float(table[-1]["success"]) == pytest.approx(summary["success"])


@pytest.mark.parametrize("parts", [0, 1, 3, 7, 20])
def test_a_run_is_evaluated_after_each_of_its_parts_but_the_last(parts):
    config = dataclasses.replace(small(7), evaluations=parts)
    at = [i for i in range(1, 8) if config.is_evaluated_at(i)]
    ends = {-(-7 * part // parts) for part in range(1, parts)} if parts else set()
    assert at == sorted(ends - {7})
