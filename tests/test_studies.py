"""The programs in `studies/`, on little work."""

import dataclasses
import shutil
import sys
from importlib import import_module
from multiprocessing.pool import ThreadPool
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pandas as pd
import pytest

import studies
from salpchain.archive import ARCHIVE, check
from salpchain.cli.main import run as command_line
from salpchain.controllers.policy import Policy
from salpchain.controllers.storage import load
from salpchain.errors import InputError
from salpchain.experiments import results
from salpchain.files import write_json
from salpchain.paper.grid import Grid, claim
from salpchain.paper.results import run_of
from salpchain.physics.chain import step
from salpchain.physics.state import Physics
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.reach.task import SCLD
from salpchain.training.run_folder import describe
from salpchain.training.settings import flat, preset
from studies import failures
from studies.bars import run as bars
from studies.budget import run as budget
from studies.factors import run as factors
from studies.recipe import causes
from studies.short import run as short
from studies.transfer import run as transfer
from tests.documents import ROOT
from tests.interop.policies import fresh


def in_files(folder):
    """What the repository keeps of a study; neither unpacked runs nor what hangs on versions."""
    paths = [*folder.glob("*.md"), *folder.glob("results/[!.]*"), *folder.glob("results/report/*")]
    drawn = {".png", ".pdf", ".html", ".json"}
    files = [path for path in paths if path.is_file() and path.suffix not in drawn]
    return {path.relative_to(folder): path.read_bytes() for path in files}


# Words after the program's name; the folder of the study itself is OUT.
COMMITTED = {
    "factors": ["OUT"],
    "budget": ["OUT", "any-length"],
    "short": ["any-length-1", "OUT"],
    "transfer": ["any-length-1", "OUT"],
    "bars": ["PAPER", "OUT"],
}
# What is made again of raw results that are packed; of others only their report.
MADE = {
    "factors": ["report.md", "results/factors.csv"],
    "budget": ["report.md", "results/budget.csv"],
    "paper": [
        "results/report/report.md",
        "results/report/training.csv",
        "results/report/zero-shot-fixed.csv",
        "results/report/zero-shot-scaled.csv",
    ],
}


def packed(name, folder):
    """A copy of what the repository keeps of a study, without what it makes of its results."""
    ignored = shutil.ignore_patterns("seed-*", "greedy")
    shutil.copytree(ROOT / "studies" / name, folder / name, ignore=ignored)
    for path in MADE.get(name, ["report.md"]):
        (folder / name / path).unlink()
    return folder / name


def works(*_, **__):
    raise AssertionError("what is done is done again")


@pytest.mark.parametrize("name", COMMITTED)
def test_a_study_finds_what_the_repository_keeps_done_and_makes_the_same_report(
    name, tmp_path, monkeypatch
):
    """So every number of its tables is that of the raw results."""
    out = packed(name, tmp_path)
    words = {"OUT": str(out), "PAPER": str(packed("paper", tmp_path) / "results")}
    monkeypatch.setattr(sys, "argv", [name, *(words.get(word, word) for word in COMMITTED[name])])
    module = import_module(f"studies.{name}.run")
    for work in ("train_or_go_on", "train_together", "evaluate", "run_trials", "make_env"):
        monkeypatch.setattr(module, work, works, raising=False)
    here = SimpleNamespace(Pool=lambda *_, **__: ThreadPool(1))
    monkeypatch.setattr(factors, "get_context", lambda _: here)
    module.main()
    assert in_files(out) == in_files(ROOT / "studies" / name)


@pytest.mark.slow
def test_the_papers_study_is_found_done_and_makes_the_same_tables(tmp_path, monkeypatch, capsys):
    out = packed("paper", tmp_path)
    words = ["reproduce", "--preset", "quick", "--seeds", "3", "--out", str(out / "results")]
    assert command_line([*words, "--dry-run"]) == 0
    assert "42 of 42 runs are done" in capsys.readouterr().out
    monkeypatch.setattr(sys, "argv", ["paper", str(out)])
    with pytest.raises(SystemExit) as end:
        import_module("studies.paper.run").main()
    assert end.value.code == 0
    assert in_files(out) == in_files(ROOT / "studies" / "paper")


def test_the_archives_of_the_repository_are_whole():
    found = sorted((ROOT / "studies").glob(f"*/results/{ARCHIVE}"))
    assert {path.parent.parent.name: check(path.parent)[0] for path in found} == {
        "budget": 9, "factors": 336, "paper": 212,
    }  # fmt: skip


def test_results_in_the_folder_of_the_report_are_not_begun_again(tmp_path):
    (tmp_path / "about.json").write_text("{}")
    with pytest.raises(InputError, match=r"results itself, .* move all but report\.md to"):
        transfer.study(fresh(), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["about.json"]


def test_a_larger_thrust_limit_is_a_larger_thrust():
    start = jax.jit(SCLD(TaskConfig(length=4, contact=False)).reset)(jr.key(0)).chain
    thrust = jnp.array([1.0, -0.5, 0.3, 1.0])
    swims = (1.2 * thrust, Physics()), (thrust, transfer.changed(thrust=1.2))
    go = jax.jit(lambda chain, thrust, physics: step(chain, thrust, physics, contact=False))
    ends = []
    for pushed, physics in swims:
        chain = start
        for _ in range(20):
            chain = go(chain, pushed, physics)
        ends.append(chain.units.position)
    np.testing.assert_allclose(*ends, atol=2e-4)
    assert float(jnp.abs(ends[0] - start.units.position).max()) > 0.02


def test_a_policy_swims_in_vmas_as_it_does_here_and_a_stopped_study_goes_on(tmp_path, monkeypatch):
    monkeypatch.setattr(transfer, "step_limit", lambda *_: 8)
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
    frame = pd.read_csv(tmp_path / "results" / "vmas.csv")
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
        run.mkdir(parents=True)
        write_json(run / "config.json", describe(config, devices, "none"))
        write_json(run / "summary.json", {})

    monkeypatch.setattr(
        factors, "VARIANTS", {k: factors.VARIANTS[k] for k in ("base", "no entropy")}
    )
    monkeypatch.setattr(factors, "LENGTHS", (4, 8))
    monkeypatch.setattr(factors, "GROUPS", ((4, 8),))
    stands_in = {"evaluate": test, "load": lambda run: None}
    for module, named in ((studies, {"train": learn}), (factors, stands_in)):
        for name, stand_in in named.items():
            monkeypatch.setattr(module, name, stand_in)
    for _ in range(2):
        factors.study(tmp_path, 2)
    assert done == [(name, seed) for seed in (0, 1) for name in ("base", "no-entropy")]
    assert (tmp_path / "results" / "factors.png").read_bytes().startswith(b"\x89PNG")
    assert (
        "| no entropy | 2 | 50 (50 to 50) | 100 (100 to 100) |"
        in (tmp_path / "report.md").read_text()
    )

    changed = dataclasses.replace(factors.VARIANTS["base"], steps=7)
    monkeypatch.setattr(factors, "VARIANTS", {"base": changed})
    with pytest.raises(InputError, match="base/seed-0 holds a run with other settings"):
        factors.study(tmp_path, 1)


def test_results_of_another_policy_are_not_taken_for_those_of_this(tmp_path, monkeypatch):
    monkeypatch.setattr(transfer, "LENGTHS", ())
    mine, other = fresh(), fresh("gatv2")
    alike = Policy(other.network, mine.card)
    for _ in range(2):
        results.claim(tmp_path, "transfer", mine, trials=4)
    kept = (tmp_path / "about.json").read_text()
    for policy, trials, word in (
        (alike, 4, "weights is"),
        (other, 4, "policy is gcn-mixed there"),
        (mine, 5, "trials is 4 there, 5 was"),
    ):
        with pytest.raises(InputError, match=word):
            results.claim(tmp_path, "transfer", policy, trials=trials)
    with pytest.raises(InputError, match="study is transfer there, budget was given"):
        results.claim(tmp_path, "budget")
    assert (tmp_path / "about.json").read_text() == kept
    (tmp_path / "about.json").unlink()
    (tmp_path / "vmas.csv").write_text("x\n")
    with pytest.raises(InputError, match="study is unknown there"):
        results.claim(tmp_path, "transfer", mine, trials=4)
    (tmp_path / "about.json").write_text("[1]")
    with pytest.raises(InputError, match=r"about\.json is damaged"):
        results.claim(tmp_path, "transfer", mine, trials=4)


@pytest.mark.parametrize("content", ["", "x,y\n1,2\n", 'length\n"2\n', "length\n1,2\n3,4,5\n"])
def test_a_damaged_file_of_results_is_one_line_and_stays(content, tmp_path):
    path = tmp_path / "short.csv"
    path.write_text(content)
    with pytest.raises(InputError, match=r"short\.csv is damaged"):
        results.add_part(path, {"length": 2}, lambda: pytest.fail("played"))
    assert path.read_text() == content


@pytest.mark.parametrize(
    ("program", "words", "line"),
    [
        ("factors", [], "give a folder"),
        ("factors", ["OUT", "0"], "give a folder, and how many seeds"),
        ("factors", ["OUT", "²"], "give a folder, and how many seeds"),
        ("factors", ["/proc/x"], "/proc/x"),
        ("short", ["any-length", "/proc/x"], "/proc/x"),
        ("budget", ["/proc/x", "gt"], "/proc/x"),
        ("budget", ["OUT", "nobody"], "ways if not all: any-length, ten"),
        ("release", ["nobody"], "name a policy to make"),
        ("release", ["paper-gcn-8", "/proc/x"], "/proc/x"),
        ("bars", ["STUDY"], "give a study and a folder"),
        ("bars", ["STUDY", "OUT"], "it has no grid.json"),
        ("transfer", ["any-length"], "give a policy and a folder"),
        ("paper", [], "give a folder"),
        ("recipe", [], "give a folder"),
        ("recipe", ["OUT", "many"], "how many workers"),
        ("recipe.causes", [], "give a folder"),
        ("recipe.causes", ["OUT", "many"], "how many steps"),
        ("recipe.causes", ["OUT", "0"], "steps must be positive"),
    ],
)
def test_a_program_says_what_is_wrong_in_one_line(
    program, words, line, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [program, *words])
    module = import_module(f"studies.{program}" if "." in program else f"studies.{program}.run")
    with pytest.raises(SystemExit) as end:
        studies.program(program, module.main, module.__doc__)
    assert end.value.code == 2
    said = capsys.readouterr().err.strip()
    assert line in said and said.startswith(f"studies.{program}: ") and "\n" not in said
    assert list(tmp_path.iterdir()) == []


def test_a_program_tells_what_it_does(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["factors", "--help"])
    studies.program("factors", factors.main, factors.__doc__)
    assert "python -m studies.factors.run OUT [SEEDS]" in capsys.readouterr().out


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


def test_what_one_test_in_many_would_find_by_chance_is_not_told_as_found():
    """p values by hand: 0.0213 of 30 points; of 10 points 0.288, in 22 other differences."""
    names = list(factors.VARIANTS)[:14]
    shift = {"base": 0.0, names[1]: 0.3, names[2]: 0.8}
    rows = [
        {"variant": name, "seed": f"seed-{seed}", "length": n, "success": x, "closed_fraction": 1.0}
        for name in names
        for seed, x in enumerate(0.9 - shift.get(name, 0.1) + np.array([0.0, -0.1, 0.1]))
        for n in factors.LENGTHS
    ]
    text = factors.as_markdown(pd.DataFrame(rows))
    assert f"| {names[1]} | -30.0 [-52.7, -7.3] |" in text
    assert f"| {names[2]} | **-80.0 [-102.7, -57.3]** |" in text


# Of these, two settings go together, or the one that matters brings the others along.
TOGETHER = {
    "model gatv2": {"control.model", "control.improved"},
    "model gt": {"control.model", "control.improved"},
    "no folded starts": {"task.folded", "task.stalled"},
    "no starts on the target": {"task.folded", "task.stalled"},
    "trained on 8": {"mix.lengths", "task.length"},
    "trained on 4 to 8": {"mix.lengths", "task.length"},
}


def settings(config):
    """Every setting by its name, those of a part as "part.name"."""
    values = {}
    for part, group in dataclasses.asdict(config).items():
        if isinstance(group, dict):
            values |= {f"{part}.{name}": value for name, value in group.items()}
        else:
            values[part] = group
    return values


@pytest.mark.parametrize("name", [name for name in factors.VARIANTS if name != "base"])
def test_a_variant_changes_one_thing(name):
    own = settings(factors.VARIANTS[name])
    other = settings(factors.VARIANTS[factors.AGAINST.get(name, "base")])
    changed = {key for key in own if own[key] != other[key]}
    assert changed == TOGETHER[name] if name in TOGETHER else len(changed) == 1


@pytest.mark.parametrize(("name", "other"), [("paper", "quick"), ("quick", "paper")])
def test_the_causes_together_are_all_that_the_presets_differ_in(name, other):
    here, there = (flat(preset(x, length=causes.UNITS)) for x in (name, other))
    alone = [flat(x) for preset, _, x in causes.variants(1000) if preset == name][1:]
    changed = [{path for path in here if one[path] != here[path]} for one in alone]
    unasked = {"preset", "steps", "evaluations"}
    assert set.union(*changed) | unasked == {path for path in here if here[path] != there[path]}
    assert sum(len(one - unasked) for one in changed) == len(set.union(*changed) - unasked)


def test_a_changed_time_limit_is_another_at_the_lengths_of_training():
    base = SCLD(factors.VARIANTS["base"].task)
    for name, steps in (("time limit of 256 steps", 256), ("time limit of 1024 steps", 1024)):
        env = SCLD(factors.VARIANTS[name].task)
        assert [int(env.step_limit(n)) for n in (2, 16)] == [steps, steps]
    assert [int(base.step_limit(n)) for n in (2, 16)] == [512, 512]


def test_a_tighter_goal_is_part_of_the_study_of_short_chains(tmp_path, monkeypatch):
    played = []

    def trials(controllers, length, number, time_limit, seed, task):
        played.append((controllers[0].card.name, length, task.tolerance))
        rows = {"length": length, "trial": range(number), "success": True, "steps_to_goal": 20.0}
        return [pd.DataFrame({**rows, "closed_fraction": 1 - task.tolerance})]

    monkeypatch.setattr(short, "run_trials", trials)
    monkeypatch.setattr(short, "TRIALS", {2: 3})
    for _ in range(2):
        short.study(load("any-length"), tmp_path)
    assert [(name, length) for name, length, _ in played] == [
        ("any-length", 2),
        ("any-length", 2),
        ("mpc", 2),
        ("mpc", 2),
    ]
    text = (tmp_path / "report.md").read_text()
    assert "| 2 | any-length, goal of 2 cm | 3 | 100.0 % | 98.0 % | 20.0 |" in text
    for name in ("mpc", "mpc, from what any-length would do"):
        assert f"| 2 | {name} | 3 | 100.0 % | 94.9 % | 20.0 |" in text


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
    assert trained == [[0, 1, 2]] and tested == ["seed-0", "seed-1", "seed-2"]
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
        bars.study(tmp_path, tmp_path / "bars")
    eight = [(f"gcn-mixed-8/seed-{seed}", 8) for seed in (0, 1)]
    sixteen = [("gcn-mixed-16/seed-0", n) for n in (16, 96, 128)]
    assert sorted(played) == sorted([*eight, *sixteen])
    row = "| gcn-mixed-8 | 8 | fixed | 2 x 200 | 50.0 (50.0 to 50.0) | 85.0 (85.0 to 85.0) |"
    assert row in (tmp_path / "bars" / "report.md").read_text()


def trial(**others):
    usual = {"final_distance": 0.1, "start_distance": 1.0, "docks": 1, "parted_links": 0}
    return pd.Series({**usual, "wall_impulse": 0.0, "steps": 900, **others})


@pytest.mark.parametrize(
    ("measures", "what"),
    [
        ({"final_distance": 0.9, "wall_impulse": 70.0}, "stuck at a wall"),
        ({"final_distance": 0.9, "parted_links": 1}, "lost"),
        ({"wall_impulse": 70.0, "docks": 0, "parted_links": 1}, "never docked"),
        ({"docks": 1, "parted_links": 1}, "out of time: parted"),
        ({}, "out of time: one chain"),
    ],
)
def test_a_failed_trial_is_sorted_by_what_it_failed_of(measures, what):
    assert failures.cause(trial(**measures)) == what


def test_failures_of_the_policy_alone_are_listed(tmp_path, capsys, monkeypatch):
    about = {"length": 8, "seed": 1, "time_limit": "scaled"}
    rows = [
        {**trial(), **about, "policy": "caravan", "trial": 0, "success": True},
        {**trial(parted_links=1), **about, "policy": "caravan", "trial": 1, "success": False},
        {**trial(parted_links=1), **about, "policy": "caravan", "trial": 4, "success": False},
        {**trial(final_distance=2.0), **about, "policy": "greedy", "trial": 1, "success": False},
    ]
    pd.DataFrame(rows).to_csv(tmp_path / "evaluation.csv", index=False)
    write_json(tmp_path / "evaluation.json", {"policy": "caravan", "lengths": []})
    monkeypatch.setattr(sys, "argv", ["failures", str(tmp_path)])
    failures.main()
    assert capsys.readouterr().out == "8 units, out of time: parted: 2 (trials 1, 4)\n"
    kept = pd.read_csv(tmp_path / "failures.csv")
    assert kept.trial.tolist() == [1, 4] and set(kept.cause) == {"out of time: parted"}
    with pytest.raises(InputError, match=r"holds no evaluation\.csv"):
        failures.failures(tmp_path / "other")
    pd.DataFrame(rows).drop(columns="docks").to_csv(tmp_path / "evaluation.csv", index=False)
    with pytest.raises(InputError, match="whose chains do not part: it has no docks"):
        failures.failures(tmp_path)
