"""Evaluations in the learning figure, asked of Matplotlib."""

import json

import numpy as np
import pandas as pd
import pytest

from salpchain.errors import InputError
from salpchain.report.figures import learning_curves
from salpchain.report.judged import OF_ONE, OF_SEEDS, judged
from tests.report.test_figures import make_run

STEPS = [10_000, 20_000, 30_000]


def evaluate(run, successes, lengths=(8,), trials=50):
    """Writes the evaluations of a run, with these shares of successes at every length."""
    rows = [
        {"iteration": i + 1, "steps": steps, "length": n, "trials": trials, "success": share}
        | {"success_low": 0.0, "success_high": 1.0, "closed_fraction": share / 2}
        for i, (steps, share) in enumerate(zip(STEPS, successes, strict=False))
        for n in lengths
    ]
    pd.DataFrame(rows).to_csv(run / "evaluations.csv", index=False)
    return run


def figure_of(runs, tmp_path, monkeypatch):
    kept = []
    keep = lambda figure, out: kept.append(figure) or []  # noqa: E731
    monkeypatch.setattr("salpchain.report.figures.save", keep)
    learning_curves(runs, tmp_path / "x")
    return kept[0]


def diamonds(panel):
    """The points that are drawn, (point, [steps, value]), and the ends of their intervals."""
    [(points, _, [bars])] = [box.lines for box in panel.containers]
    return points.get_xydata(), np.array(bars.get_segments())[:, :, 1]


def legend(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_evaluations_of_a_run_stand_on_its_curve_with_their_intervals(tmp_path, monkeypatch):
    run = evaluate(make_run(tmp_path / "run", 0), (0.1, 0.5, 1.0))
    figure = figure_of([run], tmp_path, monkeypatch)
    success, intervals = diamonds(figure.axes[0])
    np.testing.assert_allclose(success, [[0.01, 0.1], [0.02, 0.5], [0.03, 1.0]])
    np.testing.assert_allclose(intervals[1], [0.366, 0.634], atol=1e-3)  # 25 of 50, Wilson
    closed, _ = diamonds(figure.axes[1])
    np.testing.assert_allclose(closed[:, 1], [0.05, 0.25, 0.5])
    assert legend(figure) == ["gcn mixed, 8 units", f"deterministic evaluation ({OF_ONE})"]
    assert figure.axes[0].get_ylabel() == "lines: in training,\n10-rollout mean"


def test_evaluations_of_seeds_are_their_mean_as_far_as_all_have_come(tmp_path, monkeypatch):
    runs = [make_run(tmp_path / str(seed), seed) for seed in (0, 1)]
    evaluate(runs[0], (0.2, 0.4, 0.8)), evaluate(runs[1], (0.4, 0.8))
    figure = figure_of(runs, tmp_path, monkeypatch)
    success, intervals = diamonds(figure.axes[0])
    np.testing.assert_allclose(success, [[0.01, 0.3], [0.02, 0.6]])
    np.testing.assert_allclose(intervals, [[0.2, 0.4], [0.4, 0.8]])
    assert legend(figure) == [
        "gcn mixed, 8 units (2 seeds)",
        f"deterministic evaluation ({OF_SEEDS})",
    ]
    assert figure.axes[0].get_ylabel().endswith("mean ± standard error")


def test_trials_of_several_lengths_count_together(tmp_path):
    run = evaluate(make_run(tmp_path / "run", 0), (0.5,), lengths=(4, 8), trials=25)
    points = judged([run], "success")
    assert len(points.steps) == 1 and points.mean[0] == 0.5
    assert points.low[0] == pytest.approx(0.366, abs=1e-3)  # as of 50 trials


def test_a_run_without_evaluations_is_drawn_without_them(tmp_path, monkeypatch):
    figure = figure_of([make_run(tmp_path / "run", 0)], tmp_path, monkeypatch)
    assert legend(figure) == ["gcn mixed, 8 units"] and not figure.axes[0].containers


def test_a_damaged_table_of_evaluations_is_refused_by_name(tmp_path):
    run = make_run(tmp_path / "run", 0)
    for content in ("a,b\n1,2\n", json.dumps({"a": 1})):
        (run / "evaluations.csv").write_text(content + "\n1\n")
        with pytest.raises(InputError, match=r"evaluations\.csv is not a log of a run"):
            learning_curves([run], tmp_path / "x")
