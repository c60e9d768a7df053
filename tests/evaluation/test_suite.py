"""A suite's cells are what `evaluate` plays in their worlds, from the same starts."""

import hashlib
import json
import re
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest

from salpchain.controllers.greedy import Greedy
from salpchain.controllers.policy import PolicyCard
from salpchain.errors import InputError
from salpchain.evaluation.starts import REACH, domain_for, start_keys
from salpchain.evaluation.statistics import interval_of_mean, share
from salpchain.evaluation.suite import run_suite
from salpchain.evaluation.suite_trials import run_cells
from salpchain.evaluation.suites import GRADES, SUITES, Cell, Suite, suite
from salpchain.evaluation.trials import run_trials
from salpchain.physics.state import Physics
from salpchain.ranges import as_range
from salpchain.report.suite import heat_map, suite_page, verdict
from salpchain.world.config import CurrentConfig, DynamicsConfig, ThrusterConfig, WorldConfig

SEA = SUITES["sea"]
TROUBLES = ["delay", "noise", "dropout", "repeat", "dead", "failing", "weak", "current"]
TROUBLES += ["one-sided", "physics", "substeps", "all"]
SHORT = replace(REACH, most_steps=12)


def test_the_suite_has_every_trouble_in_three_grades_and_still_water_first():
    first, *others = SEA.cells(8)
    assert (first.trouble, first.grade) == ("still", "none")
    assert first.worlds["still"].is_still
    wanted = [(trouble, grade) for trouble in TROUBLES for grade in ("easy", "medium", "hard")]
    assert [(cell.trouble, cell.grade) for cell in others] == wanted
    assert SEA.lengths == (4, 8, 16, 32, 64) and SEA.trials == 200


def test_what_a_version_holds_never_changes():
    held = [
        (cell.trouble, cell.grade, [(k, w.changes(WorldConfig())) for k, w in cell.worlds.items()])
        for length in SEA.lengths
        for cell in SEA.cells(length)
    ]
    digest = hashlib.sha256(repr(held).encode()).hexdigest()[:16]
    assert (SEA.version, digest) == (1, "c2e375b8915ef795")


def test_the_hardest_grade_of_all_leaves_half_of_the_thrusters_at_first_and_a_half_at_the_end():
    for length in SEA.lengths:
        for grade, dies in zip(GRADES, (1, max(1, length // 4), length // 2), strict=True):
            (cell,) = (c for c in SEA.cells(length) if (c.trouble, c.grade) == ("all", grade))
            for world in cell.worlds.values():
                parts = world.thrusters.dead.low, world.thrusters.failing.low
                assert sum(round(part * length) for part in parts) == dies


class Pusher:
    """All units push with all they have."""

    card = PolicyCard("pusher")

    def act(self, state):
        return jnp.ones((len(state.thrust), 1))


def test_what_is_drawn_of_a_world_is_drawn_for_each_trial_or_once_for_all():
    """Half of the units are dead. All chains start straight, so their ways are alike where the same
    units are."""
    half = WorldConfig(thrusters=ThrusterConfig(dead=as_range(0.5)))
    cells = [Cell("dead", "2", {name: half}, name == "once") for name in ("each", "once")]
    ways = run_cells(Pusher(), cells, 4, 12, "scaled", 0, task=replace(REACH, most_steps=30))
    each, once = (ways[ways["kind"] == name] for name in ("each", "once"))
    assert each["start_distance"].tolist() == once["start_distance"].tolist()
    assert each["path_efficiency"].round(3).nunique() > 2
    assert np.ptp(once["path_efficiency"]) < 1e-4


@pytest.fixture(scope="module")
def played():
    cells = list(SEA.cells(4))
    return cells, run_cells(Greedy(), cells, 4, 5, "scaled", 3, task=SHORT)


SAMPLED = [("still", "none"), ("noise", "hard"), ("dead", "medium"), ("current", "medium")]
SAMPLED += [("one-sided", "hard"), ("physics", "hard"), ("substeps", "easy"), ("all", "medium")]


@pytest.mark.slow
@pytest.mark.parametrize(("trouble", "grade"), SAMPLED)
def test_a_cell_is_what_its_worlds_are_by_themselves(played, trouble, grade):
    cells, frame = played
    (cell,) = (c for c in cells if (c.trouble, c.grade) == (trouble, grade))
    rows = frame.loc[(frame.trouble == trouble) & (frame.grade == grade)].reset_index(drop=True)
    assert rows.kind.tolist() == [list(cell.worlds)[i % len(cell.worlds)] for i in range(5)]
    kind = list(cell.worlds)[-1]
    (alone,) = run_trials([Greedy()], 4, 5, "scaled", 3, world=cell.worlds[kind], task=SHORT)
    mine = rows.kind == kind
    for name in ("final_distance", "closed_fraction", "thrust_effort", "fewest_steps", "possible"):
        one, other = (x.loc[mine, name].to_numpy(float) for x in (rows, alone))
        np.testing.assert_allclose(one, other, rtol=0.01, atol=1e-3, err_msg=name)


@pytest.mark.slow
def test_troubles_tell(played):
    """Each hard cell swims otherwise than still water, from the same start."""
    frame = played[1]
    still = frame.loc[frame.trouble == "still"]
    for trouble in TROUBLES:
        hard = frame.loc[(frame.trouble == trouble) & (frame.grade == "hard")]
        np.testing.assert_array_equal(hard.start_distance, still.start_distance)
        apart = np.abs(hard.final_distance.to_numpy() - still.final_distance.to_numpy())
        assert apart.max() > (1e-5 if trouble == "substeps" else 1e-3), trouble


class Drifter(Greedy):
    """Does nothing."""

    def act(self, state):
        return jnp.zeros((len(state.thrust), 1))


@pytest.mark.slow
def test_a_chain_that_does_nothing_after_it_arrived_is_carried_off_by_the_water():
    """It has arrived at once where the goal is wide; then it gains the water's speed U and goes on:
    after k steps it has come U dt (k - 3 (1 - 0.75^k)) far, as each step takes a quarter of what
    its speed differs by. Where the goal is not taken, nothing is told."""
    swift = WorldConfig(current=CurrentConfig(speed=as_range(0.08)))
    told = {}
    for tolerance in (1.0, 0.001):
        task = replace(REACH, tolerance=tolerance, most_steps=3)
        cells = [Cell("current", "hard", {"swift": swift})]
        told[tolerance] = run_cells(Drifter(), cells, 4, 12, "scaled", 0, task=task)
    assert told[1.0].success.sum() > 2
    assert not told[0.001].success.any() and told[0.001].farthest_after.isna().all()
    env = domain_for([Drifter()], 4, "scaled", swift)
    for row, key in zip(told[1.0].itertuples(), start_keys(0, 4, jnp.arange(12)), strict=True):
        if not row.success:
            continue
        state = env.reset(key, 4)
        steps = np.arange(1, 102)[:, None, None]
        way = (
            0.1 * (steps - 3 * (1 - 0.75**steps)) * np.asarray(env.world_of(state).current.velocity)
        )
        apart = np.asarray(state.chain.units.position - state.target)[:4] + way
        wanted = np.linalg.norm(apart, axis=-1).mean(axis=1).max()
        assert row.farthest_after == pytest.approx(wanted, rel=0.02)


def few(name="few", trials=4):
    weak = WorldConfig(dynamics=DynamicsConfig(drag=as_range(2.0)))
    fine = WorldConfig(dynamics=DynamicsConfig(substeps=2))
    troubles = {"thick": lambda grade, length: {"one": weak, "other": fine}}
    return Suite(name, 3, (2,), trials, troubles)


def test_worlds_of_one_cell_must_share_their_substeps():
    with pytest.raises(ValueError, match="substeps"):
        run_cells(Greedy(), list(few().cells(2)), 2, 2, "scaled", 0, task=SHORT)


@pytest.mark.slow
def test_the_summary_is_that_of_the_trials(tmp_path, monkeypatch):
    world = WorldConfig(dynamics=DynamicsConfig(drag=as_range(3.0)))
    thick = {"thick": lambda grade, length: {"thick": world}}
    monkeypatch.setitem(SUITES, "few", Suite("few", 3, (2,), 6, thick))
    told = []
    summary = run_suite("greedy", "few", out=tmp_path, progress=lambda x, what: told.append(x))
    assert summary == json.loads((tmp_path / "suite.json").read_text())
    assert told == sorted(told) and told[-1] == pytest.approx(1)
    about = {name: summary[name] for name in ("policy", "suite", "version", "lengths", "trials")}
    assert about == {"policy": "greedy", "suite": "few", "version": 3, "lengths": [2], "trials": 6}
    first, *others = summary["cells"]
    assert first["trouble"] == "still" and [c["grade"] for c in others] == list(GRADES)
    (still,) = run_trials([Greedy()], 2, 6, "scaled", 0)
    (trials,) = run_trials([Greedy()], 2, 6, "scaled", 0, world=world)
    for cell in others:
        assert cell["success"] == share(int(trials.success.sum()), 6)
        lost = still.success.to_numpy(float) - trials.success
        low, high = interval_of_mean(lost.to_numpy())
        assert cell["loss"] == {"mean": lost.mean(), "low": low, "high": high}
        stayed = rows_of(tmp_path, cell).farthest_after.dropna() <= 0.05
        assert (cell["stayed"] is None) == (not len(stayed))
        assert not len(stayed) or cell["stayed"]["mean"] == stayed.mean()
        assert cell["possible"] == trials.possible.mean()
        assert "kinds" not in cell


def rows_of(folder, cell):
    frame = pd.read_csv(folder / "suite.csv")
    return frame.loc[(frame.trouble == cell["trouble"]) & (frame.grade == cell["grade"])]


def test_other_results_are_kept_unless_told_otherwise(tmp_path, monkeypatch):
    monkeypatch.setitem(SUITES, "few", Suite("few", 1, (2,), 2, {}))
    run_suite("greedy", "few", out=tmp_path)
    before = (tmp_path / "suite.json").read_bytes()
    run_suite("greedy", "few", out=tmp_path)
    for other in ({"seed": 1}, {"trials": 3}, {"lengths": 3}):
        with pytest.raises(InputError, match=f"{next(iter(other))} .* there, .* asked for"):
            run_suite("greedy", "few", out=tmp_path, **other)
    with pytest.raises(InputError, match="policy greedy there, approach asked for"):
        run_suite("approach", "few", out=tmp_path)
    assert (tmp_path / "suite.json").read_bytes() == before
    run_suite("greedy", "few", seed=1, out=tmp_path, overwrite=True)
    assert json.loads((tmp_path / "suite.json").read_text())["seed"] == 1
    (tmp_path / "suite.json").write_text("[]")
    with pytest.raises(InputError, match="no result of a suite"):
        run_suite("greedy", "few", out=tmp_path)


def test_an_unknown_suite_is_refused_with_the_names_that_there_are():
    with pytest.raises(InputError, match="unknown suite 'see': choose one of sea"):
        suite("see")
    assert isinstance(next(iter(SEA.cells(4))), Cell)
    assert Physics().substeps == 15


def cell(trouble, grade, length, mean, **more):
    success = {"mean": mean, "low": max(0.0, mean - 0.1), "high": min(1.0, mean + 0.1)}
    value = {"mean": 0.5, "median": 1.25, "iqm": 0.5, "low": 0.4, "high": 0.6}
    return {
        "trouble": trouble, "grade": grade, "length": length, "trials": 10, "success": success,
        "stayed": None if mean < 0.5 else success, "possible": 0.9, "closed_fraction": value,
        "steps_to_goal": value, "time_ratio": value,
        "loss": {"mean": 1 - mean, "low": 0.0, "high": None if mean == 1 else 1.0}, **more,
    }  # fmt: skip


CELLS = [
    cell("still", "none", 4, 1.0),
    cell("delay", "easy", 4, 0.8),
    cell("delay", "hard", 4, 0.25, kinds={"both": {"mean": 0.25}, "one": {"mean": 0.5}}),
    cell("still", "none", 8, 1.0),
    cell("delay", "easy", 8, 0.9),
    cell("delay", "hard", 8, 0.75, kinds={"both": {"mean": 1.0}, "one": {"mean": 0.5}}),
]
SUMMARY = {
    "policy": "mine", "identity": "abc", "suite": "sea", "version": 1, "lengths": [4, 8],
    "trials": 10, "time_limit": "scaled", "seed": 0, "cells": CELLS,
}  # fmt: skip


def test_the_verdict_names_each_grades_mean_and_the_worst_cell():
    assert verdict(CELLS) == (
        "Success, mean over cells: easy 85 %, hard 50 %; least 25 % (delay hard, 4 units)."
    )
    assert verdict(CELLS[:1]).endswith("least 100 % (still, 4 units).")


def test_the_page_holds_every_cell_and_the_map(tmp_path):
    paths = suite_page(SUMMARY, tmp_path)
    names = ["suite.md", "suite.html", "suite.png", "suite.pdf"]
    assert [path.name for path in paths] == names and all(path.stat().st_size for path in paths)
    text, page = (path.read_text() for path in paths[:2])
    assert "| hard | 4 | 25 (15 to 35) | 75 (0 to 100) | - | 90 | 50.0 | 1.25 | 25 | 50 |" in text
    assert "| none | 8 | 100 (90 to 100) | 0 | 100 (90 to 100) | 90 | 50.0 | 1.25 |" in text
    assert len(re.findall("<h2>", page)) == 2 and "data:image/png" in page
    assert (
        "| easy | 4 | 80 (70 to 90) | 20 (0 to 100) | 80 (70 to 90) | 90 | 50.0 | 1.25 | - | - |"
        in text
    )
    assert "suite.png" in text and verdict(CELLS) in text


@pytest.mark.parametrize("cells", [CELLS, CELLS[:1]])
def test_the_map_has_a_row_for_each_trouble_and_grade(cells, tmp_path):
    assert heat_map(cells, tmp_path / "map.png")[0].read_bytes()[1:4] == b"PNG"
