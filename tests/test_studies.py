"""The programs in `studies/`, on little work."""

import numpy as np
import pandas as pd

from salpchain.cluster.grid import Grid, claim
from salpchain.cluster.results import run_of
from salpchain.control.storage import load
from salpchain.files import write_json
from studies import bars, budget, factors, short, transfer
from tests.interop.policies import fresh


def test_a_policy_swims_in_vmas_as_it_does_here_and_a_stopped_study_goes_on(tmp_path, monkeypatch):
    monkeypatch.setattr(transfer, "step_limit", lambda *_: 12)
    monkeypatch.setattr(transfer, "LENGTHS", (3,))
    monkeypatch.setattr(transfer, "SETTINGS", {"nothing": transfer.SETTINGS["nothing"]})
    played = []

    def trials(policy, *part):
        played.append(part)
        rows = {"setting": ["nothing"], "length": 3, "trial": 0, "success": True}
        return pd.DataFrame({**rows, "closed_fraction": 0.9})

    monkeypatch.setattr(transfer, "with_changes", trials)
    for _ in range(2):
        transfer.study(fresh(), tmp_path, trials=4)
    assert played == [("nothing", 3, 4)]
    frame = pd.read_csv(tmp_path / "vmas.csv")
    assert len(frame) == 8
    there, here = (frame[frame.engine == name] for name in ("VMAS", "ours"))
    assert (there.success.to_numpy() == here.success.to_numpy()).all()
    np.testing.assert_allclose(there.closed_fraction, here.closed_fraction, atol=1e-3)
    assert there.closed_fraction.abs().max() > 0.01
    text = (tmp_path / "report.md").read_text()
    assert "| VMAS |" in text and "| nothing | 100.0 (90.0) |" in text


def test_what_is_trained_and_tested_is_not_done_again_and_is_reported(tmp_path, monkeypatch):
    done = []

    def test(policy, lengths, trials, time_limit, seed, out, baseline):
        closed = {"closed_fraction": {"mean": 0.9}}
        rows = [{"length": n, "success": {"mean": n / 8}, **closed} for n in lengths]
        out.mkdir(parents=True, exist_ok=True)
        write_json(out / "evaluation.json", {"lengths": rows})

    def learn(config, run, devices):
        done.append((run.parent.name, config.seed))

    monkeypatch.setattr(
        factors, "VARIANTS", {k: factors.VARIANTS[k] for k in ("base", "no entropy")}
    )
    monkeypatch.setattr(factors, "LENGTHS", (4, 8))
    monkeypatch.setattr(factors, "GROUPS", ((4, 8),))
    for name, stand_in in (("train", learn), ("evaluate", test), ("load", lambda run: None)):
        monkeypatch.setattr(factors, name, stand_in)
    for _ in range(2):
        factors.study(tmp_path, 2)
    assert done == [(name, seed) for seed in (0, 1) for name in ("base", "no-entropy")]
    assert (tmp_path / "factors.png").read_bytes().startswith(b"\x89PNG")
    assert (
        "| no entropy | 2 | 50 (50 to 50) | 100 (100 to 100) |"
        in (tmp_path / "report.md").read_text()
    )


def test_the_report_says_what_a_change_buys_with_the_interval_of_welch():
    rows = [
        {"variant": name, "seed": f"seed-{seed}", "length": n, "success": x, "closed_fraction": 1.0}
        for name, seeds in (("graph near", (0.5, 0.6, 0.7)), ("base", (0.9, 0.8, 1.0)))
        for seed, x in enumerate(seeds)
        for n in factors.LENGTHS
    ]
    text = factors.as_markdown(pd.DataFrame(rows))
    # by hand: t of 4 degrees of freedom at 97.5 % is 2.776, standard errors 10 / sqrt(3) each
    assert "| graph near | **-30.0 [-52.7, -7.3]** | **-30.0 [-52.7, -7.3]** |" in text
    factors.as_markdown(pd.DataFrame(rows[: 3 * len(factors.LENGTHS)]))  # base is not done yet


def test_each_variant_changes_one_thing():
    base = factors.VARIANTS["base"]
    for name, config in factors.VARIANTS.items():
        assert config.steps == base.steps and config.preset == base.preset
        assert (config == base) == (name == "base")


def test_a_tighter_goal_is_part_of_the_study_of_short_chains(tmp_path, monkeypatch):
    played = []

    def trials(controllers, length, number, time_limit, seed, tolerance):
        played.append((controllers[0].card.name, length, tolerance))
        rows = {"length": length, "trial": range(number), "success": True, "steps_to_goal": 20.0}
        return [pd.DataFrame({**rows, "closed_fraction": 1 - tolerance})]

    monkeypatch.setattr(short, "run_trials", trials)
    monkeypatch.setattr(short, "TRIALS", {2: 3})
    for _ in range(2):
        short.study(load("any-length"), tmp_path)
    assert [(name, length) for name, length, _ in played] == [
        ("any-length", 2),
        ("any-length", 2),
        ("mpc", 2),
    ]
    text = (tmp_path / "report.md").read_text()
    assert "| 2 | any-length, goal of 2 cm | 3 | 100.0 % | 98.0 % | 20.0 |" in text
    assert "| 2 | mpc | 3 | 100.0 % | 94.9 % | 20.0 |" in text


def test_seeds_of_a_way_train_together_and_each_is_tested_once(tmp_path, monkeypatch):
    trained, tested = [], []

    def learn(configs, runs, devices):
        trained.append([config.seed for config in configs])
        for config, run in zip(configs, runs, strict=True):
            run.mkdir(parents=True, exist_ok=True)
            write_json(run / "summary.json", {"steps": config.steps})

    def test(policy, lengths, trials, time_limit, seed, out, baseline):
        tested.append(out.name)
        one = {"success": {"mean": 0.9}, "closed_fraction": {"mean": 0.8}}
        rows = [{"length": n, "steps_to_goal": {"median": n / 2}, **one} for n in lengths]
        write_json(out / "evaluation.json", {"lengths": rows})

    for name, stand_in in (("train_together", learn), ("evaluate", test), ("load", lambda _: None)):
        monkeypatch.setattr(budget, name, stand_in)
    for _ in range(2):
        budget.train_all(tmp_path, "any-length")
        budget.test_all(tmp_path, "any-length")
    assert trained == [[0, 1, 2]] * 2 and tested == ["seed-0", "seed-1", "seed-2"]
    text = (tmp_path / "report.md").read_text()
    assert "| any-length, seed 2 | 30,000,000 | 90.0 | " in text
    assert text.endswith("| 32 | 48 | 64 |\n")  # steps at 64, 96 and 128 units


def test_ten_times_the_steps_are_as_many_updates():
    once, ten = (budget.WAYS[name].config for name in ("any-length", "ten times the steps"))
    assert ten.total_steps == 10 * once.total_steps
    assert (ten.iterations, ten.ppo.minibatches) == (once.iterations, once.ppo.minibatches)


def test_runs_on_mixed_are_tested_at_their_length_and_those_of_the_longest_beyond(
    tmp_path, monkeypatch
):
    grid = Grid(models=("mlp", "gcn"), lengths=(8, 16), seeds=2)
    claim(tmp_path, grid)
    for job in (job for job in grid.jobs() if job.name != "gcn-mixed-16/seed-1"):  # not trained yet
        run_of(tmp_path, job).mkdir(parents=True)
        (run_of(tmp_path, job) / "summary.json").write_text("{}")
    played = []

    def trials(policies, length, *_):
        played.append((*policies, length))
        return [pd.DataFrame({"success": [True, False], "closed_fraction": [0.9, 0.8]})]

    monkeypatch.setattr(bars, "load", lambda run: f"{run.parent.name}/{run.name}")
    monkeypatch.setattr(bars, "run_trials", trials)
    for _ in range(2):
        bars.study(tmp_path)
    eight = [(f"gcn-mixed-8/seed-{seed}", 8) for seed in (0, 1)]
    sixteen = [("gcn-mixed-16/seed-0", n) for n in (16, 96, 128)]
    assert sorted(played) == sorted([*eight, *sixteen])
    row = "| gcn-mixed-8 | 8 | fixed | 2 x 200 | 50.0 (50.0 to 50.0) | 85.0 (85.0 to 85.0) |"
    assert row in (tmp_path / "bars.md").read_text()
