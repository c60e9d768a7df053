"""A study's claims are judged by its numbers, and its pages say what they were."""

import re

import numpy as np
import pandas as pd
import pytest

from salpchain.paper.claims import facts, judge, success_at_end
from salpchain.paper.comparison import beside_figure_3, beside_figure_4
from salpchain.paper.figures import figure_3, figure_4, interval_half, normalised_curves
from salpchain.paper.reference import AT, FIGURE_3, FIGURE_4
from salpchain.paper.report import claims_table
from salpchain.paper.tables import (
    Entry,
    breakpoint_of,
    episode_return,
    reach_of,
    zero_shot_table,
)
from salpchain.report.pages import Report, Table, write_report

TESTS = (4, 8, 12, 16, 20, 24, 28, 32)
BEST = {"gt mixed": 0.96, "gt full": 0.96, "mlp": 0.93, "gcn mixed": 0.92, "gatv2 mixed": 0.92}
PAPER = {**BEST, "gcn full": 0.7, "gatv2 full": 0.8}  # success at the end of training


def log(success, rollouts=40):
    rise = np.linspace(0, success, rollouts - 4)
    return pd.DataFrame(
        {
            "iteration": np.arange(1, rollouts + 1),
            "steps": 100 * np.arange(1, rollouts + 1),
            "episodes": 10,
            "success": [*rise, *[success] * 4],
            "closed_fraction": [*rise, *[success] * 4],
            "reward_approach": 0.01,
        }
    )


def flat_then_linear(at, knee):
    return 1.0 if at <= knee else 1.0 - 0.02 * (at - knee)


def zero_shot_of(knee):
    """Closed fraction 1 up to the knee, then falling in a line; distance likewise."""
    rows = []
    for at in TESTS:
        held = flat_then_linear(at, knee)
        rows.append(
            {
                "length": at,
                "trials": 50,
                "success": {"mean": held, "low": held - 0.1, "high": held + 0.1},
                "closed_fraction": {"mean": held, "low": held - 0.1, "high": None},
                "final_distance": {"mean": 1.0 - held},
                "reachable": {"mean": 1.0},
                "start_distance": {"mean": 0.1 * at},
            }
        )
    return {"lengths": rows}


def entries(successes, knee=16, lengths=(8,), seeds=2):
    made = []
    for length in lengths:
        for seed in range(seeds):
            for name, success in successes.items():
                model, _, graph = name.partition(" ")
                tests = {} if model == "mlp" else {"fixed": zero_shot_of(knee)}
                made.append(Entry(model, graph, length, seed, log(success), tests))
    return made


def verdicts(some):
    return {claim.text: claim.held for claim in judge(facts(some, "fixed"))}


def test_all_claims_hold_in_a_study_like_the_papers():
    found = verdicts(entries(PAPER))
    assert len(found) == 6 and set(found.values()) == {True}


@pytest.mark.parametrize(
    ("changed", "claim"),
    [
        ({"mlp": 0.99}, "trains best"),
        ({"gatv2 mixed": 0.5}, "come close"),
        ({"gcn full": 0.95}, "fall behind"),
        ({"gt full": 0.8}, "as well on full"),
    ],
)
def test_a_claim_about_training_falls_with_its_numbers(changed, claim):
    found = verdicts(entries({**PAPER, **changed}))
    assert [held for text, held in found.items() if claim in text] == [False]


@pytest.mark.parametrize(
    ("changed", "claim"),
    [({"mlp": 0.965}, "trains best"), ({"mlp": 0.9, "gatv2 full": 0.895}, "fall behind")],
)
def test_a_lead_of_less_than_a_point_tells_nothing(changed, claim):
    found = verdicts(entries({**PAPER, **changed}))
    assert [held for text, held in found.items() if claim in text] == [None]


def test_the_breakpoint_claim_falls_when_controllers_break_down_earlier():
    found = verdicts(entries(PAPER, knee=8))
    assert [held for text, held in found.items() if "twice" in text] == [False]
    assert [held for text, held in found.items() if "linearly" in text] == [True]


def test_what_a_study_did_not_train_it_cannot_tell():
    found = verdicts(entries({"gcn mixed": 0.9}))
    assert len(found) == 6 and set(found.values()) == {None}


def test_of_runs_in_which_no_episode_ended_the_tests_are_told_all_the_same(tmp_path):
    some = entries(PAPER)
    for entry in some:
        entry.log[["episodes", "success", "closed_fraction"]] = 0, np.nan, np.nan
    found = verdicts(some)
    assert [held for text, held in found.items() if "trains best" in text] == [None]
    assert [held for text, held in found.items() if "twice" in text] == [True]
    assert beside_figure_3(some).rows == []
    assert figure_3(some, tmp_path / "3.png")[0].stat().st_size > 5000


def test_tests_that_end_before_twice_the_length_tell_nothing_of_it():
    found = verdicts(entries(PAPER, lengths=(32,)))
    assert [held for text, held in found.items() if "twice" in text] == [None]


def test_performance_that_rises_with_length_does_not_decay():
    some = entries(PAPER)
    for entry in some:
        for row in entry.tests.get("fixed", {"lengths": []})["lengths"]:
            row["final_distance"] = {"mean": 1.0 - 0.01 * row["length"]}
    assert [held for text, held in verdicts(some).items() if "linearly" in text] == [False]


def test_the_papers_own_curves_hold_what_the_paper_says_of_them():
    """By the same rules: up to 64 units its curves fall to 0."""
    for length, curves in FIGURE_4.items():
        some = []
        for name, curve in curves.items():
            distance = [1 - value for value in curve]
            rows = zero_shot_of(99)["lengths"][: len(AT)] * 2
            tests = [
                {**rows[0], "length": at, "final_distance": {"mean": value}}
                for at, value in zip((*AT, 64), (*distance, 1.0), strict=True)
            ]
            model, graph = name.split()
            trained = log(FIGURE_3[length][name])
            some.append(Entry(model, graph, length, 0, trained, {"fixed": {"lengths": tests}}))
        some.append(Entry("mlp", "", length, 0, log(FIGURE_3[length]["mlp"]), {}))
        found = verdicts(some)
        for words in ("twice", "fall behind", "as well on full"):
            assert [held for text, held in found.items() if words in text] == [True], words


def test_two_training_lengths_are_judged_apart_and_compared():
    found = verdicts(entries(PAPER, knee=32, lengths=(8, 16)))
    assert None not in {held for text, held in found.items() if "twice" in text}
    assert sum(text.startswith("8 units") for text in found) == 4
    assert sum(text.startswith("16 units") for text in found) == 4
    assert [v for text, v in found.items() if "serve shorter chains" in text] == [True]


def test_success_at_the_end_is_that_of_the_last_tenth():
    table = log(0.8)
    table.loc[: len(table) - 5, "success"] = 0.0
    assert success_at_end(table) == pytest.approx(0.8)
    table["episodes"] = 0
    assert np.isnan(success_at_end(table))


def test_a_return_is_the_goal_and_the_metres_closed():
    """100 steps a rollout that close 0.01 m each, by 10 episodes: a whole one is worth 2 m."""
    table = log(1.0)
    table["closed_fraction"], table["success"] = 0.05, 0.5
    assert episode_return(table).to_numpy() == pytest.approx(0.5 + 2.0 * 0.05)
    table["closed_fraction"] = 0.0  # nothing closed: nothing to tell what a whole one is worth
    assert episode_return(table).to_numpy() == pytest.approx(0.5)
    table.loc[3, "episodes"] = 0
    assert np.isnan(episode_return(table)[3])


def test_a_learning_curve_counts_each_episode_once_from_when_all_have_had_one():
    """The few that end first are the quick ones, and would make the start look best."""
    table = log(0.2)
    table["closed_fraction"] = 0.0
    table["success"], table["episodes"] = 0.2, 10
    table.loc[:2, ["success", "episodes"]] = 1.0, 1
    made = [Entry("mlp", "", 8, 0, table, {}, settled) for settled in (0, 1000)]
    early, fair = (normalised_curves([entry])["mlp"] for entry in made)
    assert early.index[0] == 100 and fair.index[0] == 1000
    assert float(early.iloc[0, 0]) == 1.0
    window = [(3 + 5 * 10 * 0.2) / 53, 0.2]  # at step 800, 8 rollouts; at the end, 0.2 in all
    smooth = normalised_curves([made[0]])["mlp"][0]
    assert smooth[800] == pytest.approx((window[0] - 0.2) / 0.8, abs=1e-6)


def test_a_breakpoint_is_the_last_length_before_the_first_below_90_percent():
    table = zero_shot_table(entries({"gcn mixed": 1.0}, knee=16), "fixed")
    assert breakpoint_of(table, "closed_fraction") == 20
    assert breakpoint_of(table[table["at"] > 24], "closed_fraction") is None


def test_a_controller_reaches_as_far_around_its_training_length_as_it_serves_all():
    held = [0.8, 0.95, 0.95, 0.9, 0.7, 0.99]
    table = pd.DataFrame({"at": [4, 8, 12, 16, 20, 24], "closed_fraction": held})
    assert reach_of(table, "closed_fraction", 8) == (8, 16)
    assert reach_of(table, "closed_fraction", 23) == (24, 24)
    assert reach_of(table, "closed_fraction", 20) is None
    assert reach_of(table.iloc[1:4], "closed_fraction", 12) == (8, 16)


def test_intervals_over_seeds_are_students():
    assert interval_half(np.array([1.0]), 1) == 0
    assert interval_half(np.array([1.0]), 3)[0] == pytest.approx(4.303 / 3**0.5, rel=1e-3)


def test_the_papers_figures_are_drawn_of_any_part_of_a_study(tmp_path):
    for some in (entries(PAPER, lengths=(8, 16)), entries({"gcn mixed": 0.9}, seeds=1)):
        for path in (
            *figure_3(some, tmp_path / "3.png"),
            *figure_4(some, "fixed", tmp_path / "4.png"),
        ):
            assert path.stat().st_size > 10_000


def test_the_page_needs_no_other_file_and_escapes_what_it_shows(tmp_path):
    [image, _] = figure_3(entries({"mlp": 0.9}), tmp_path / "figure-3.png")
    table = Table("Times <b>", ["a|b", "c"], [["1", "<script>"]])
    claims = claims_table(judge(facts(entries(PAPER), "fixed")))
    report = Report("Title", "It held.", ["About & more"], [claims, table], {"Figure 3": image})
    text, page = (path.read_text() for path in write_report(report, tmp_path))
    assert "![Figure 3](figure-3.png)" in text and "a\\|b" in text and "| held |" in text
    assert "<script>" not in page and "About &amp; more" in page
    assert re.findall(r'(?:src|href)="(?!data:)', page) == []


def test_a_study_stands_beside_the_papers_figures(tmp_path):
    some = entries(PAPER, knee=16, lengths=(8, 4), seeds=1)
    rows = {tuple(row[:2]): row[2:] for row in beside_figure_4(some, "fixed").rows}
    assert rows["gcn mixed", "8"] == ["1.00 / 0.96", "0.50 / 0.79", "0.00 / 0.60"]
    assert rows["gt full", "4"] == ["1.00 / -", "0.50 / -", "0.00 / -"]
    rows = {tuple(row[:2]): row[2:] for row in beside_figure_3(some).rows}
    assert rows["mlp", "8"][1] == "0.93" and rows["mlp", "4"][1] == "-"
    assert 0 <= float(rows["mlp", "8"][0]) <= 1
