import json

import numpy as np
import pandas as pd
import pytest

from salpchain.evaluation.statistics import (
    DIFFICULTY,
    MEASURES,
    describe,
    interquartile_mean,
    interval_of_mean,
    paper_normalised,
    share,
    summarise,
)


def frame(lengths=(4, 8), trials=10, policy="swimmer", seed=0):
    rng = np.random.default_rng(seed)
    rows = [
        {
            **{"policy": policy, "length": n, "trial": i, "seed": 3, "time_limit": "fixed"},
            "success": bool(rng.random() < 0.5),
            **{name: rng.random() for name in (*MEASURES, *DIFFICULTY)},
        }
        for n in lengths
        for i in range(trials)
    ]
    return pd.DataFrame(rows)


@pytest.mark.parametrize(("wins", "trials"), [(0, 10), (3, 10), (47, 50), (50, 50), (1, 2)])
def test_the_interval_of_success_is_wilsons_formula(wins, trials):
    z, p = 1.959963984540054, wins / trials
    centre = (p + z**2 / (2 * trials)) / (1 + z**2 / trials)
    half = z / (1 + z**2 / trials) * np.sqrt(p * (1 - p) / trials + z**2 / (4 * trials**2))
    found = share(wins, trials)
    assert found["mean"] == p
    assert found["low"] == pytest.approx(max(centre - half, 0), abs=1e-9)
    assert found["high"] == pytest.approx(min(centre + half, 1), abs=1e-9)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 7, 50, 101])
def test_the_interquartile_mean_leaves_out_the_lowest_and_the_highest_quarter(count):
    values = np.random.default_rng(count).normal(size=count)
    cut = count // 4
    assert interquartile_mean(values) == pytest.approx(np.sort(values)[cut : count - cut].mean())


def test_the_bootstrap_interval_covers_the_true_mean_about_95_times_in_100():
    rng = np.random.default_rng(1)
    intervals = [interval_of_mean(rng.exponential(1.0, 60)) for _ in range(200)]
    covered = np.mean([low <= 1.0 <= high for low, high in intervals])
    assert 0.88 <= covered <= 0.98


def test_the_interval_is_close_to_the_normal_one_and_the_same_each_time():
    values = np.random.default_rng(2).normal(5.0, 2.0, 400)
    low, high = interval_of_mean(values)
    error = 1.96 * values.std() / 20
    assert (low, high) == pytest.approx((values.mean() - error, values.mean() + error), abs=0.02)
    assert (low, high) == interval_of_mean(values)


def test_equal_values_have_themselves_as_interval_and_a_single_one_has_none():
    assert interval_of_mean(np.full(20, 0.1)) == (0.1, 0.1)
    assert describe(np.array([0.4]))["mean"] == 0.4
    assert describe(np.array([0.4]))["low"] is None


def test_values_that_are_missing_are_left_out_and_none_at_all_is_none():
    assert describe(np.array([1.0, np.nan, 3.0]))["mean"] == 2.0
    assert set(describe(np.array([np.nan, np.nan])).values()) == {None}


def test_a_summary_has_an_entry_for_each_length_with_the_means_of_its_rows():
    rows = frame(lengths=(8, 4))
    summary = summarise(rows)
    assert [entry["length"] for entry in summary["lengths"]] == [4, 8]
    assert (summary["policy"], summary["time_limit"], summary["seed"]) == ("swimmer", "fixed", 3)
    for entry in summary["lengths"]:
        own = rows[rows.length == entry["length"]]
        assert entry["trials"] == 10
        assert entry["success"]["mean"] == own.success.mean()
        for name in MEASURES:
            assert entry[name]["mean"] == pytest.approx(own[name].mean())
            assert entry[name]["median"] == pytest.approx(own[name].median())
            assert entry[name]["low"] <= entry[name]["mean"] <= entry[name]["high"]


def test_a_summary_is_json_without_nan():
    rows = frame()
    rows["steps_to_goal"] = np.nan
    for some in (rows, rows[:1]):
        summary = summarise(some)
        assert json.loads(json.dumps(summary, allow_nan=False)) == summary
    assert summarise(rows)["lengths"][0]["steps_to_goal"]["mean"] is None


@pytest.mark.parametrize("other", [{"policy": "b"}, {"seed": 4}, {"time_limit": "scaled"}])
def test_trials_of_different_kinds_are_not_mixed(other):
    rows = frame()
    with pytest.raises(ValueError, match="a summary is of one"):
        summarise(pd.concat([rows, rows.assign(**other)]))


def test_the_papers_normalisation_runs_from_1_to_0_and_hides_the_scale():
    distances = np.array([0.1, 0.05, 0.4, 2.0])
    curve = paper_normalised(distances)
    assert curve.max() == curve[1] == 1 and curve.min() == curve[3] == 0
    np.testing.assert_allclose(paper_normalised(7 * distances + 3), curve)
    assert np.isnan(paper_normalised(np.array([0.3]))).all()


def test_the_normalised_curve_of_a_summary_follows_its_lengths():
    rows = frame(lengths=(4, 8, 12))
    rows["final_distance"] = rows["length"] / 10.0
    assert summarise(rows)["paper_normalised"] == pytest.approx([1.0, 0.5, 0.0])
    assert summarise(rows[rows.length == 4])["paper_normalised"] == [None]


def test_trials_are_shared_out_by_the_third_of_their_own_length():
    rows = frame(lengths=(4, 8), trials=9)
    rows["far"] = np.where(rows.length == 4, 0.0, 100.0) + rows.trial % 9
    rows["success"] = rows.trial >= 6
    thirds = summarise(rows)["by_difficulty"]["far"]
    assert [third["third"] for third in thirds] == ["low", "middle", "high"]
    assert [third["trials"] for third in thirds] == [6, 6, 6]
    assert [third["success"]["mean"] for third in thirds] == [0, 0, 1]
    assert [third["mean"] for third in thirds] == pytest.approx([51, 54, 57])


def test_a_length_whose_trials_are_all_as_hard_is_in_no_third():
    rows = frame(lengths=(2, 4), trials=9)
    rows["bend"] = np.where(rows.length == 2, 0.0, rows.trial)
    thirds = summarise(rows)["by_difficulty"]["bend"]
    assert [third["trials"] for third in thirds] == [3, 3, 3]
    assert [third["mean"] for third in thirds] == pytest.approx([1, 4, 7])
    assert summarise(rows[rows.length == 2])["by_difficulty"]["bend"] == []
    rows["bend"] = np.where(rows.trial < 5, 0.0, rows.trial)  # the third and the fourth are alike
    assert summarise(rows)["by_difficulty"]["bend"] == []


def test_two_trials_make_no_third_of_their_own():
    thirds = summarise(frame(trials=2))["by_difficulty"]["turn"]
    assert sum(third["trials"] for third in thirds) == 4
