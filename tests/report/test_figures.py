import io
import json
from dataclasses import asdict
from functools import cache

import matplotlib.image
import numpy as np
import pandas as pd
import pytest
from matplotlib import rcParams
from matplotlib.figure import Figure

from salpchain.errors import InputError
from salpchain.evaluation.statistics import DIFFICULTY, MEASURES, summarise
from salpchain.report.figures import learning_curves, over_seeds, zero_shot
from salpchain.report.style import legend_below
from salpchain.world.presets import world_config


def log(seed=0, rollouts=30, shift=0.0):
    rng = np.random.default_rng(seed)
    episodes = rng.integers(0, 9, rollouts) * (np.arange(rollouts) > 3)
    none = episodes == 0
    return pd.DataFrame(
        {
            "iteration": np.arange(1, rollouts + 1),
            "steps": 1000 * np.arange(1, rollouts + 1),
            "episodes": episodes,
            "success": np.where(none, np.nan, rng.random(rollouts) / 2 + shift),
            "closed_fraction": np.where(none, np.nan, rng.random(rollouts)),
        }
    )


def make_run(folder, seed, graph="mixed"):
    folder.mkdir()
    config = {"task": {"length": 8}, "control": {"model": "gcn", "graph": graph}, "seed": seed}
    (folder / "config.json").write_text(json.dumps({"format": 1, "config": config}))
    log(seed).to_csv(folder / "metrics.csv", index=False)
    return folder


@cache
def summary(policy, time_limit, lengths, trials):
    rng = np.random.default_rng(len(policy))
    about = {"policy": policy, "seed": 0, "time_limit": time_limit}
    rows = [
        {**about, "length": n, "trial": i, "success": rng.random() < 0.5}
        | {name: rng.random() for name in (*MEASURES, *DIFFICULTY)}
        for n in lengths
        for i in range(trials)
    ]
    return summarise(pd.DataFrame(rows))


def make_evaluation(path, policy="swimmer", time_limit="fixed", lengths=(4, 8, 16), trials=6):
    content = {
        **summary(policy, time_limit, tuple(lengths), trials),
        "card": {"length": 8, "steps": 1000},
        "baseline": summary("greedy", time_limit, tuple(lengths), trials),
    }
    path.write_text(json.dumps(content))
    return path


def check_figure(paths, least=15_000):
    png, pdf = paths
    assert png.suffix == ".png" and pdf.suffix == ".pdf"
    assert least < png.stat().st_size < 1_000_000 and 5_000 < pdf.stat().st_size < 500_000
    assert pdf.read_bytes().startswith(b"%PDF")
    height, width = matplotlib.image.imread(png).shape[:2]
    assert width > 1.5 * height > 900


def test_curves_of_several_groups_are_drawn_as_png_and_pdf(tmp_path):
    runs = [make_run(tmp_path / f"{g}{s}", s, g) for g in ("mixed", "full") for s in (0, 1)]
    check_figure(learning_curves(runs, tmp_path / "made" / "learning.png"))


def test_a_curve_is_the_mean_over_seeds_with_its_standard_error():
    logs = [log(seed).fillna(0.3) for seed in range(4)]
    curve = over_seeds(logs, "success", 1)
    shown = ~np.any([x.episodes == 0 for x in logs], axis=0)
    values = np.array([x.success.to_numpy() for x in logs])[:, shown]
    np.testing.assert_array_equal(curve.steps, logs[0].steps[shown])
    np.testing.assert_allclose(curve.mean, values.mean(0))
    np.testing.assert_allclose(curve.error, values.std(0, ddof=1) / 2)


def test_rollouts_count_by_the_episodes_that_ended_in_them():
    one = log()
    curve = over_seeds([one], "success", 5)
    for steps, mean in zip(curve.steps, curve.mean, strict=True):
        last = one[(one.steps > steps - 5000) & (one.steps <= steps) & (one.episodes > 0)]
        assert mean == pytest.approx((last.success * last.episodes).sum() / last.episodes.sum())
    assert (curve.error == 0).all()


def test_seeds_are_averaged_only_as_far_as_all_have_come():
    curve = over_seeds([log(0, 30), log(1, 20)], "success", 10)
    assert curve.steps.max() == 20_000


def test_runs_that_differ_in_their_seed_alone_are_one_line(tmp_path, monkeypatch):
    drawn = {}
    monkeypatch.setattr(
        "salpchain.report.figures._draw_curve", lambda panel, look, name, c: drawn.update({name: c})
    )
    runs = [make_run(tmp_path / str(s), s) for s in (0, 1, 2)] + [
        make_run(tmp_path / "f", 0, "full")
    ]
    learning_curves(runs, tmp_path / "x")
    assert sorted(drawn) == ["gcn full, 8 units", "gcn mixed, 8 units (3 seeds)"]


@pytest.mark.parametrize("lines", [2, 9])
def test_a_legend_of_any_number_of_lines_lies_within_its_figure(lines):
    figure = Figure(figsize=(8, 3), layout="constrained")
    panel = figure.subplots()
    for number in range(lines):
        panel.plot([0, 1], label=f"controller {number} (3 seeds)")
    legend_below(figure, [panel])
    figure.savefig(io.BytesIO())
    box = figure.legends[0].get_window_extent()
    assert box.x0 >= 0 and box.x1 <= figure.bbox.width
    assert len(figure.legends) == 1


def test_zero_shot_curves_are_drawn_from_files_and_folders(tmp_path):
    (tmp_path / "folder").mkdir()
    make_evaluation(tmp_path / "folder" / "evaluation.json")
    other = make_evaluation(tmp_path / "other.json", "drifter", "scaled")
    check_figure(zero_shot([tmp_path / "folder", other], tmp_path / "zero"))


def test_a_single_trial_at_a_single_length_can_be_drawn(tmp_path):
    one = make_evaluation(tmp_path / "one.json", lengths=(8,), trials=1)
    check_figure(zero_shot([one], tmp_path / "zero.pdf"))


def test_drawing_twice_gives_the_same_bytes_and_leaves_the_settings_alone(tmp_path):
    before, run = dict(rcParams), make_run(tmp_path / "run", 0)
    one, other = (learning_curves([run], tmp_path / name) for name in ("a", "b"))
    assert [p.read_bytes() for p in one] == [p.read_bytes() for p in other]
    assert dict(rcParams) == before


@pytest.mark.parametrize("draw", [learning_curves, zero_shot])
def test_nothing_to_draw_is_an_error_that_says_what_is_needed(draw, tmp_path):
    with pytest.raises(InputError, match="must have at least one"):
        draw([], tmp_path / "x")


@pytest.mark.parametrize("content", ["", "a,b\n1,2\n", b"\xff\xfe\x00"])
def test_a_damaged_log_is_refused_by_name(tmp_path, content):
    run = make_run(tmp_path / "run", 0)
    (run / "metrics.csv").write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError, match=r"metrics\.csv is not the log of a run"):
        learning_curves([run], tmp_path / "x")


def test_a_figure_is_whole_or_not_there(tmp_path):
    run = make_run(tmp_path / "run", 0)
    (tmp_path / "half.pdf").mkdir()
    with pytest.raises(InputError, match=r"half\.pdf is a folder"):
        learning_curves([run], tmp_path / "half.png")
    assert not (tmp_path / "half.png").exists()


def test_what_is_no_run_or_no_evaluation_is_refused(tmp_path):
    run = make_run(tmp_path / "run", 0)
    (run / "metrics.csv").unlink()
    (tmp_path / "config.json").write_text("{}")
    empty = {"policy": "x", "time_limit": "fixed", "lengths": []}
    (tmp_path / "empty.json").write_text(json.dumps(empty))
    with pytest.raises(InputError, match=r"no metrics\.csv"):
        learning_curves([run], tmp_path / "x")
    with pytest.raises(InputError, match="does not describe a run"):
        learning_curves([tmp_path], tmp_path / "x")
    for name in ("config.json", "empty.json"):
        with pytest.raises(InputError, match="is not an evaluation"):
            zero_shot([tmp_path / name], tmp_path / "x")
    with pytest.raises(InputError, match="no such file"):
        zero_shot([tmp_path / "missing.json"], tmp_path / "x")


def drawn_curves(monkeypatch):
    """The names of the learning curves, as they are drawn."""
    drawn = []
    draw = lambda panel, look, name, curve: drawn.append(name)  # noqa: E731
    monkeypatch.setattr("salpchain.report.figures._draw_curve", draw)
    return drawn


def test_the_same_settings_and_seed_twice_are_two_lines_by_their_folders(tmp_path, monkeypatch):
    drawn = drawn_curves(monkeypatch)
    (tmp_path / "deep").mkdir()
    runs = [make_run(tmp_path / "one", 0), make_run(tmp_path / "deep" / "two", 0)]
    learning_curves(runs, tmp_path / "x")
    assert drawn == ["one", "deep/two"] * 2
    with pytest.raises(InputError, match="is given twice"):
        learning_curves([*runs, runs[0]], tmp_path / "x")


def test_a_run_with_a_name_of_its_own_is_drawn_by_it(tmp_path, monkeypatch):
    drawn = drawn_curves(monkeypatch)
    runs = [make_run(tmp_path / str(seed), seed) for seed in (0, 1, 2)]
    for run in runs[:2]:
        content = json.loads((run / "config.json").read_text())
        content["config"]["name"] = "mine"
        (run / "config.json").write_text(json.dumps(content))
    learning_curves(runs, tmp_path / "x")
    assert drawn[:2] == ["mine (2 seeds)", "gcn mixed, 8 units"]


def test_runs_in_different_worlds_are_told_apart_by_their_names(tmp_path, monkeypatch):
    drawn = drawn_curves(monkeypatch)
    runs = [make_run(tmp_path / name, 0) for name in ("still", "failing")]
    for run in runs:
        content = json.loads((run / "config.json").read_text())
        content["config"]["world"] = asdict(world_config(run.name))
        (run / "config.json").write_text(json.dumps(content))
    learning_curves(runs, tmp_path / "x")
    assert drawn[:2] == ["gcn mixed, 8 units, world still", "gcn mixed, 8 units, world failing"]


def test_a_setting_that_a_run_of_before_lacks_tells_nothing_apart(tmp_path, monkeypatch):
    drawn = drawn_curves(monkeypatch)
    runs = [make_run(tmp_path / str(seed), seed) for seed in (0, 1)]
    content = json.loads((runs[1] / "config.json").read_text())
    content["config"] |= {"evaluations": 0, "name": ""}
    (runs[1] / "config.json").write_text(json.dumps(content))
    learning_curves(runs, tmp_path / "x")
    assert drawn[:1] == ["gcn mixed, 8 units (2 seeds)"]


def legend_of(paths, tmp_path, monkeypatch):
    figures = []
    keep = lambda figure, out: figures.append(figure) or []  # noqa: E731
    monkeypatch.setattr("salpchain.report.figures.save", keep)
    zero_shot(paths, tmp_path / "x")
    return [text.get_text() for text in figures[0].legends[0].get_texts()]


def evaluations(tmp_path, *whose, policy="swimmer"):
    """An evaluation in a folder of its own for each identity and time limit."""
    for number, (identity, limit) in enumerate(whose):
        folder = tmp_path / f"run-{number}" / "evaluation"
        folder.mkdir(parents=True)
        path = make_evaluation(folder / "evaluation.json", policy, limit)
        path.write_text(json.dumps(json.loads(path.read_text()) | {"identity": identity}))
        yield folder


def test_evaluations_of_one_name_are_told_apart_by_folders_and_none_is_dropped(
    tmp_path, monkeypatch
):
    paths = list(evaluations(tmp_path, ("a", "fixed"), ("b", "fixed")))
    assert {"run-0", "run-1"} <= set(legend_of(paths, tmp_path, monkeypatch))
    with pytest.raises(InputError, match="is given twice"):
        zero_shot([paths[0], paths[0] / "evaluation.json"], tmp_path / "x")


@pytest.mark.parametrize(
    ("whose", "told"),
    [
        ("aa", {"swimmer, 512 steps", "swimmer, scaled time"}),
        ("ab", {"run-0, 512 steps", "run-1, scaled time"}),
    ],
)
def test_a_policy_under_two_limits_keeps_its_name_but_two_policies_do_not(
    whose, told, tmp_path, monkeypatch
):
    paths = evaluations(tmp_path, *zip(whose, ("fixed", "scaled"), strict=True))
    assert told <= set(legend_of(list(paths), tmp_path, monkeypatch))


def test_greedy_and_greedy_as_a_baseline_are_both_in_the_legend(tmp_path, monkeypatch):
    paths = list(evaluations(tmp_path, ("a", "fixed"), policy="greedy"))
    assert {"greedy", "greedy (baseline)"} <= set(legend_of(paths, tmp_path, monkeypatch))


def test_a_learning_figure_before_any_cohort_is_whole_says_so(tmp_path, monkeypatch):
    run = make_run(tmp_path / "short", 0)
    rows = log(0).assign(episodes=0, success=np.nan, closed_fraction=np.nan)
    rows.to_csv(run / "metrics.csv", index=False)
    said = []
    monkeypatch.setattr(
        "salpchain.report.figures.save", lambda figure, out: said.append(figure) or []
    )
    learning_curves([run], tmp_path / "x.png")
    words = [[text.get_text() for text in panel.texts] for panel in said[0].axes]
    assert words == [["in training: too early to tell, no start cohort is whole"]] * 2
