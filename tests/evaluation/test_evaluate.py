import dataclasses
import io
import json

import numpy as np
import pandas as pd
import pytest
from rich.console import Console

from salpchain.cli.tables import difficulty_table, show, table
from salpchain.controllers.greedy import Greedy
from salpchain.controllers.mpc import MPC
from salpchain.controllers.named import load
from salpchain.controllers.policy import PolicyCard
from salpchain.errors import InputError
from salpchain.evaluation import evaluate as module
from salpchain.evaluation.evaluate import evaluate, evaluate_limits
from salpchain.evaluation.statistics import DIFFICULTY, MEASURES, summarise
from tests.own import Constant, Late

LENGTHS, TRIALS = [4, 8], 5


def trials_by_formula(controllers, length, trials, time_limits, seed, progress, world, task):
    """Stands in for `run_limits`: no swim; starts depend on seed, length and trial."""
    progress(0.5)
    progress(1.0)
    names = [controller.card.name for controller in controllers]
    return {
        limit: [frame_by_formula(name, length, trials, limit, seed) for name in names]
        for limit in time_limits
    }


def frame_by_formula(name, length, trials, time_limit, seed):
    start = np.arange(1, trials + 1) * length * seed
    about = {"policy": name, "length": length, "trial": np.arange(trials), "seed": seed}
    names = (*MEASURES, *DIFFICULTY)
    measures = dict.fromkeys(names, len(name) / 100) | {"start_distance": start, "far": start}
    return pd.DataFrame({**about, "time_limit": time_limit, "success": start % 8 == 0, **measures})


@pytest.fixture
def evaluation(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "run_limits", trials_by_formula)
    told, out = [], tmp_path / "made" / "on the way"
    tell = lambda *x: told.append(x)  # noqa: E731
    return evaluate(Constant(0.3), LENGTHS, TRIALS, "fixed", 5, out, progress=tell), out, told


def test_the_files_hold_a_row_for_each_trial_of_both_and_the_summary(evaluation):
    summary, out, _ = evaluation
    assert json.loads((out / "evaluation.json").read_text()) == json.loads(json.dumps(summary))
    rows = pd.read_csv(out / "evaluation.csv")
    counts = rows.groupby(["policy", "length"]).size()
    assert counts.to_dict() == {(p, n): TRIALS for p in ("constant", "greedy") for n in LENGTHS}
    assert sorted(path.name for path in out.iterdir()) == ["evaluation.csv", "evaluation.json"]


def test_the_baseline_meets_the_same_starts(evaluation):
    rows = pd.read_csv(evaluation[1] / "evaluation.csv")
    own, other = (rows[rows.policy == p] for p in ("constant", "greedy"))
    np.testing.assert_array_equal(own.start_distance, other.start_distance)


def test_the_summary_names_the_policy_its_card_and_the_baseline(evaluation):
    summary = evaluation[0]
    assert summary["policy"] == "constant"
    assert summary["card"] == PolicyCard(name="constant").as_dict()
    assert summary["baseline"]["policy"] == "greedy"
    assert [e["length"] for e in summary["baseline"]["lengths"]] == LENGTHS


def test_progress_rises_to_the_whole_and_says_what_is_played(evaluation):
    shares, names = zip(*evaluation[2], strict=True)
    assert list(shares) == sorted(shares) and shares[-1] == pytest.approx(1.0)
    assert list(dict.fromkeys(names)) == [f"constant and greedy, {n} units" for n in LENGTHS]


def test_the_table_shows_both_with_intervals(evaluation):
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(table(evaluation[0]))
    text = console.export_text()
    assert all(word in text for word in ("greedy", "success", "closed", "limit", "95 % interval"))
    row = next(line.split() for line in text.splitlines() if line.split()[:1] == ["4"])
    assert row[:4] == ["4", "40", "[12,", "77]"]  # Wilson's interval of two in five
    assert row[-5:] == ["0.08", "0.08", "40", "6.0", "8.0"] and "fewest" in text
    assert max(map(len, text.splitlines())) <= 80
    console.print(table({**evaluation[0], "baseline": None}))
    assert "greedy" not in console.export_text()


def test_however_many_measures_a_task_has_each_is_whole_in_80_columns(evaluation):
    names = [f"measure_number_{k}" for k in range(12)]
    wide = {"mean": 0.01234, "low": 0.01123, "high": 0.01345}
    rows = [{**row, **dict.fromkeys(names, wide)} for row in evaluation[0]["lengths"]]
    summary = {**evaluation[0], "lengths": rows, "measures": names, "baseline": {"lengths": rows}}
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(table(summary))
    lines = [line.split() for line in console.export_text().splitlines()]
    whole = ["0.0123", "[0.0112,", "0.0135]"]
    for k in range(12):
        assert lines.count(["measure", "number", str(k), *whole, *whole]) == len(LENGTHS)
    assert lines[4][:5] == ["4", "success", "0.4", "[0.118,", "0.769]"]


def test_a_second_table_shows_what_makes_trials_hard(evaluation):
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(difficulty_table(evaluation[0]))
    text = console.export_text()
    assert max(map(len, text.splitlines())) <= 80
    assert all(word in text for word in ("distance", "[", "time"))
    assert "turn of the target" not in text  # the same in all trials


def test_tables_in_a_file_have_no_blanks_at_the_ends_of_lines(evaluation, capsys):
    show(table(evaluation[0]), difficulty_table(evaluation[0]))
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) > 8 and [line for line in lines if line != line.rstrip()] == []
    show(table(evaluation[0]), difficulty_table({"by_difficulty": {}}))
    assert "by difficulty" not in capsys.readouterr().out


def test_the_table_has_room_for_its_widest_numbers_and_shows_half_steps(evaluation):
    row = evaluation[0]["lengths"][0]
    wide = {"mean": 1.0, "low": 1.0, "high": 1.0}
    steps = {"steps_to_goal": {"median": 1767.5}, "time_ratio": {"median": 11.68}}
    full = {**row, "length": 128, "success": wide, "closed_fraction": wide, "reachable": wide}
    whole = {"steps_to_goal": {"median": 62.0}}
    summary = {**evaluation[0], "lengths": [{**full, **steps}, {**full, **steps, **whole}]}
    summary["baseline"] = {"lengths": [full, full]}
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(table(summary))
    text = console.export_text()
    ends = ["11.68", "100", "100.0", "100.0"]
    both = [line.split() for line in text.splitlines() if line.split()[:1] == ["128"]]
    assert [line[-5:] for line in both] == [["1767.5", *ends], ["62", *ends]]


def test_a_single_trial_has_an_interval_of_success_alone(evaluation):
    one = summarise(frame_by_formula("greedy", 8, 1, "scaled", 5))
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(table(one))
    row = next(x.split() for x in console.export_text().splitlines() if x.split()[:1] == ["8"])
    assert row == ["8", "100", "[21,", "100]", "6.0", "0.06", "0.06", "6.0"]


def test_the_baseline_is_not_its_own_baseline(monkeypatch):
    monkeypatch.setattr(module, "run_limits", trials_by_formula)
    assert evaluate(Greedy(), [4], TRIALS, "fixed", 5)["baseline"] is None


def test_a_planner_does_not_plan_on_while_the_baseline_swims(monkeypatch):
    crews = []

    def play(controllers, *args):
        crews.append([controller.card.name for controller in controllers])
        return trials_by_formula(controllers, *args)

    monkeypatch.setattr(module, "run_limits", play)
    summary = evaluate(MPC(), [4], TRIALS, "fixed", 5)
    assert crews == [["greedy"], ["mpc"]]
    assert (summary["policy"], summary["baseline"]["policy"]) == ("mpc", "greedy")


@pytest.mark.slow
def test_a_controller_that_remembers_and_its_baseline_start_alike():
    summary = evaluate(Late(Constant(0.5)), [3], 4, "fixed", 7)
    own, other = summary["lengths"][0], summary["baseline"]["lengths"][0]
    assert own["start_distance"]["mean"] == pytest.approx(other["start_distance"]["mean"], rel=1e-5)


@pytest.mark.slow
def test_real_trials_of_both_start_alike_and_greedy_closes_more(tmp_path):
    summary = evaluate(Constant(0.5), [4], 16, "fixed", 7, tmp_path)
    own, other = summary["lengths"][0], summary["baseline"]["lengths"][0]
    assert own["start_distance"] == other["start_distance"]
    assert own["reachable"] == other["reachable"]
    assert other["closed_fraction"]["low"] > own["closed_fraction"]["high"]
    assert len(pd.read_csv(tmp_path / "evaluation.csv")) == 32


def test_no_lengths_is_an_error():
    with pytest.raises(ValueError, match="lengths must have at least one"):
        evaluate(Greedy(), [], 4, "fixed", 0)


def test_results_of_the_same_weights_under_another_name_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "run_limits", trials_by_formula)
    policy = load("any-length")
    renamed = dataclasses.replace(policy, card=dataclasses.replace(policy.card, name="mine"))
    evaluate(policy, LENGTHS, TRIALS, "fixed", 5, tmp_path)
    kept = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    says = r"under the name any-length, not mine \(the same weights, \w+\): .*overwrite=True"
    with pytest.raises(InputError, match=says):
        evaluate(renamed, LENGTHS, TRIALS, "fixed", 5, tmp_path)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == kept
    evaluate(renamed, LENGTHS, TRIALS, "fixed", 5, tmp_path, overwrite=True)
    assert json.loads((tmp_path / "evaluation.json").read_text())["policy"] == "mine"


def test_several_time_limits_give_the_files_of_each(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "run_limits", trials_by_formula)
    evaluate_limits(Greedy(), LENGTHS, TRIALS, ("fixed", "scaled"), 5, tmp_path)
    for limit in ("fixed", "scaled"):
        alone = evaluate(Greedy(), LENGTHS, TRIALS, limit, 5)
        kept = json.loads((tmp_path / limit / "evaluation.json").read_text())
        assert kept == json.loads(json.dumps(alone)) and kept["time_limit"] == limit
        assert len(pd.read_csv(tmp_path / limit / "evaluation.csv")) == TRIALS * len(LENGTHS)


def test_results_of_another_controller_or_of_other_trials_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "run_limits", trials_by_formula)
    evaluate(Constant(0.3), LENGTHS, TRIALS, "fixed", 5, tmp_path)
    kept = (tmp_path / "evaluation.json").read_bytes()
    monkeypatch.setattr(module, "run_limits", lambda *_: pytest.fail("played"))
    for controller, trials, baseline in (
        (Constant(0.4), TRIALS, True),  # of the same name
        (Constant(0.3), TRIALS + 1, True),
        (Constant(0.3), TRIALS, False),
    ):
        with pytest.raises(InputError, match="give overwrite=True"):
            evaluate(controller, LENGTHS, trials, "fixed", 5, tmp_path, baseline)
    assert (tmp_path / "evaluation.json").read_bytes() == kept
    monkeypatch.setattr(module, "run_limits", trials_by_formula)
    again = evaluate(Constant(0.3), list(reversed(LENGTHS)), TRIALS, "fixed", 5, tmp_path)
    assert (tmp_path / "evaluation.json").read_bytes() == kept and again["policy"] == "constant"
    other = evaluate(Constant(0.4), [4], 2, "scaled", 0, tmp_path, overwrite=True)
    assert json.loads((tmp_path / "evaluation.json").read_text()) == json.loads(json.dumps(other))
