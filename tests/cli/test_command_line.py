"""What a user meets on the command line; most cases in this process, for speed."""

import json
import re
import signal
import subprocess
import sys
from pathlib import Path

import jax.random as jr
import pytest

from salpchain import Trajectory, identity, load
from salpchain.cli.evaluate import default_out
from salpchain.cli.main import COMMANDS, run
from salpchain.cli.train import Train, _report, settings
from salpchain.controllers.policy import Policy, PolicyCard
from salpchain.controllers.storage import save_policy
from salpchain.installation import install_command
from salpchain.networks.actor_critic import actor_critic
from salpchain.networks.config import ControlConfig
from salpchain.tasks.features import OBSERVATIONS
from salpchain.training.config import Mix
from salpchain.training.presets import QUICK_STEPS, QUICK_STEPS_OF, choose
from salpchain.training.run_folder import create


@pytest.fixture
def policy(tmp_path):
    card = PolicyCard()
    path = tmp_path / "policy.safetensors"
    save_policy(Policy(actor_critic(jr.key(0), card.control, 22, 1, 8), card), path)
    return path


@pytest.fixture
def mlp(tmp_path):
    card = PolicyCard("mlp-8", ControlConfig(model="mlp"))
    path = tmp_path / "mlp.safetensors"
    save_policy(Policy(actor_critic(jr.key(0), card.control, 22, 1, 8), card), path)
    return path


@pytest.fixture
def fresh_run(tmp_path):
    """A run folder as it is before the first step."""
    create(tmp_path / "run", choose("quick"), 1, "cpu")
    return tmp_path / "run"


@pytest.fixture
def used(tmp_path):
    folder = tmp_path / "used"
    folder.mkdir()
    (folder / "thesis.tex").write_text("precious")
    return folder


MANY = Mix((2, 3, 4, 5), grow=0.5)

BAD = [
    (["trian"], "perhaps train"),
    (["train"], "--out"),
    (["train", "--out", "NEW", "--model", "gnn"], "choose one of gcn"),
    (["train", "--out", "NEW", "--graph", "ring"], "choose one of mixed, full"),
    (["train", "--out", "NEW", "--preset", "slow"], "choose one of quick, paper"),
    (["train", "--out", "NEW", "--observation", "sonar"], "choose one of body, table1"),
    (["train", "--out", "NEW", "--length", "1"], "2 to 1024"),
    (["train", "--out", "NEW", "--length", "eight"], "whole number"),
    (["train", "--out", "NEW", "--length", "16..4"], "runs backwards"),
    (["train", "--out", "NEW", "--length", "4..8", "--weights", "1,2"], "as many as lengths, 5"),
    (["train", "--out", "NEW", "--length", "4,8", "--weights", "1,much"], "must be numbers"),
    (["train", "--out", "NEW", "--length", "5,2", "--weights", "9,1"], "try --length 2,5"),
    (["train", "--out", "NEW", "--length", "4,4,8", "--weights", "1,2,3"], "try --length 4,8"),
    (
        ["train", "--out", "NEW", "--length", "4,8", "--weights", "nan,1"],
        "weights must be finite numbers, got (nan, 1.0)",
    ),
    (["train", "--out", "NEW", "--length", "4,8", "--weights", ""], "--weights is empty"),
    (["train", "--out", "NEW", "--seed=", "--resume"], "--seed is empty"),
    (["evaluate", "", "--out", "NEW"], "an argument is empty"),
    (["train", "--out", "NEW", "--weights", "1,2"], "needs several lengths"),
    (["train", "--out", "NEW", "--length", "8", "--curriculum", "0.9"], "needs several lengths"),
    (["train", "--out", "NEW", "--length", "4,8", "--curriculum", "90"], "in [0, 1], got 90"),
    (["train", "--out", "NEW", "--length", "4,8", "--curriculum", "0.5,1"], "must be one number"),
    (["train", "--out", "NEW", "--length", "4,8", "--model", "mlp"], "one length only"),
    (["train", "--out", "NEW", "--length", "4,8", "--preset", "paper"], "take preset quick"),
    (["train", "--out", "NEW", "--model", "mlp", "--graph", "mixed"], "an mlp has no graph"),
    (["train", "--out", "NEW", "--steps", "-5"], "positive"),
    (["train", "--out", "NEW", "--lenght", "8"], "perhaps --length"),
    (
        ["train", "--out", "NEW", "--seed", "99999999999999999999"],
        "seed must be a whole number 0 to 4294967295",
    ),
    (["evaluate", "greedy", "--out", "NEW", "--seed", "-1"], "seed must be a whole number 0 to"),
    (["evaluate", "greedy", "--out", "NEW", "--trials", "9999999"], "at most 1,000,000"),
    (["evaluate", "greedy", "--out", "USED/thesis.tex"], "a file is in the way"),
    (["train", "--out", "NEW", "--length"], "--length"),
    (["train", "--out", "USED"], "already used"),
    (["train", "--out", "USED/thesis.tex"], "is a file"),
    (["train", "--resume", "--out", "USED"], "not a run folder"),
    (["train", "--resume", "--out", "NEW"], "no such run folder"),
    (["train", "--out", "NEW", "--name", "a\nb"], "no line breaks and no control characters"),
    (["train", "--out", "NEW", "--name", "a\x1b[31mb"], "no line breaks and no control"),
    (["completion"], "salpchain completion needs a shell: bash, zsh or fish"),
    (["completion", "csh"], "unknown shell 'csh': choose one of bash, zsh, fish"),
    (["figure"], "salpchain figure needs what to draw, learning or zero-shot"),
    (["evaluate"], "needs a run folder"),
    (["evaluate", "NEW"], "no such run folder or policy"),
    (["evaluate", "USED"], "not a run folder"),
    (["evaluate", "USED/thesis.tex"], "not a salpchain policy"),
    (["evaluate", "greedy", "--lengths", "64:4"], "64:4"),
    (["evaluate", "greedy", "--lengths", "1,8"], "2"),
    (["evaluate", "greedy", "--trials", "0"], "at least 1"),
    (["evaluate", "greedy", "--time-limit", "never"], "choose one of fixed, scaled"),
    (["figure", "pie", "USED"], "choose one of learning, zero-shot"),
    (["figure", "learning"], "at least one folder"),
    (["figure", "zero-shot", "USED"], "no evaluation.json"),
    (["figure", "learning", "USED"], "not a run folder: it has no config.json (give"),
    (["figure", "learning", "NEW"], "no such run folder"),
    (["models", "--length", "1900"], "2 to 1024"),
    (["models", "any-length", "--length", "1"], "--length is for the list of controllers, got 1"),
    (["models", "any-length", "--observation", "body"], "--observation is for the list"),
    (["bench", "--envs", "0"], "at least 1"),
    (["bench", "--world", "wet"], "unknown world 'wet': choose one of still, current"),
    (["reproduce", "--out", "NEW", "--models", "mlp,gnn"], "unknown model 'gnn'"),
    (["reproduce", "--out", "NEW", "--models", "mlp", "--graphs", "full"], "an mlp has no graph"),
    (["reproduce", "--out", "NEW", "--models", "mlp", "--tests", "4,8"], "got tests at 4"),
    (["reproduce", "--out", "NEW", "--graphs", "ring"], "choose one of mixed, full"),
    (["reproduce", "--out", "NEW", "--models", "gcn,"], "--models must be names"),
    (["reproduce", "--out", "NEW", "--seeds", "0"], "seeds must be 1 to 1000, got 0"),
    (["reproduce", "--out", "NEW", "--jobs", "0"], "at least 1"),
    (["reproduce", "--out", "NEW", "--executor", "slurm"], "choose one of local, ray"),
    (["reproduce", "--out", "NEW", "--address", "head:6379"], "add --executor ray"),
    (["reproduce", "--out", "NEW", "--gpus", "1"], "add --executor ray"),
    (["reproduce", "--out", "NEW", "--executor", "ray", "--gpus", "nan"], "must be a share"),
    (["reproduce", "--out", "NEW", "--dry-run", "--executor", "ray", "--cpus", "0"], "at least 1"),
    (["reproduce", "--out", "USED", "--dry-run"], "holds something else than a study"),
    (["reproduce", "--out", ""], "--out is empty"),
    (["reproduce", "--experiment", "broken"], "choose one of paper, disabled"),
    (["reproduce", "--experiment", "disabled", "--seeds", "2"], "leave --seeds out"),
    (["reproduce", "--experiment", "disabled", "--policies", "NEW"], "no such run folder"),
    (["reproduce", "--policies", "any-length"], "add --experiment disabled"),
    (["rollout"], "needs a run folder or a policy"),
    (["rollout", "greedy"], "needs --out"),
    (["rollout", "greedy", "--out", "NEW.npy"], "must end in .npz"),
    (["rollout", "greedy", "--out", "NEW/x.npz"], "no such folder"),
    (["rollout", "NEW", "--out", "NEW.npz"], "no such run folder or policy"),
    (["rollout", "greedy", "--length", "4,8", "--out", "NEW.npz"], "whole number"),
    (["rollout", "greedy", "--trial", "-1", "--out", "NEW.npz"], "--trial must be 0 or more"),
    (["rollout", "x.npz", "--out", "NEW.npz"], "is recorded already"),
    (["video"], "needs a run folder, a policy or a trajectory"),
    (["video", "greedy", "--out", "NEW.avi"], "must end in .mp4 or .gif or .png"),
    (["video", "greedy", "--size", "big", "--out", "NEW.gif"], "like 1280x720"),
    (["video", "greedy", "--size", "3x3", "--out", "NEW.gif"], "even number of pixels"),
    (["video", "greedy", "--speed", "fast", "--out", "NEW.gif"], "--speed must be a number"),
    (["video", "NEW.npz", "--out", "NEW.gif"], "no such trajectory"),
    (["video", "NEW", "--out", "NEW.gif"], "no such run folder or policy"),
    (["replay"], "needs a run folder, a policy or a trajectory"),
    (["replay", "greedy", "--out", "NEW.pdf"], "must end in .html"),
    (["replay", "USED", "--out", "NEW.html"], "not a run folder with a policy"),
    (["live", "NEW"], "no such run folder or policy"),
    (["live", "USED"], "not a run folder with a policy"),
    (["live", "USED/thesis.tex"], "not a salpchain policy"),
    (["live", "mpc", "--port", "0"], "mpc is too slow to steer live: choose a run, or one of"),
    (["live", "--port", "70000"], "--port must be 0 to 65535"),
    (["live", "--world", "nowhere"], "unknown world 'nowhere': choose one of still, current"),
    (["live", "--set", "task.fence=true"], "--set task.fence is no setting of a world"),
    (["live", "--allow-origin", "lab.example.org"], "--allow-origin must be like https://lab"),
    (["live", "--host", "no.such.host.invalid"], "no name or address of this machine"),
    (["reproduce", "--out", "USED"], "holds something else than a study"),
    (["reproduce", "--out", "USED/thesis.tex"], "is a file"),
]


def test_an_unknown_option_is_likened_to_near_ones_alone(capsys):
    assert run(["bench", "--out", "x"]) == 2  # not to --quiet, which shares dashes
    assert capsys.readouterr().err.strip().endswith("unknown argument '--out'")


def test_an_mlp_is_refused_at_any_other_length_than_its_own(mlp, tmp_path, capsys):
    words = ["evaluate", str(mlp), "--lengths", "8,16", "--out", str(tmp_path / "new")]
    assert run(words) == 2
    assert "works at 8 units only, got length 16" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("words", "says"), BAD, ids=lambda x: " ".join(x) if isinstance(x, list) else ""
)
def test_bad_input_gets_one_line_and_status_2_and_changes_nothing(
    words, says, used, tmp_path, capsys
):
    new = tmp_path / "new"
    places = {"NEW": str(new), "USED": str(used)}
    words = [w.replace("NEW", places["NEW"]).replace("USED", places["USED"]) for w in words]
    assert run(words) == 2
    printed = capsys.readouterr()
    said = printed.err.strip()
    assert printed.out == "" and said.startswith("salpchain: error:") and "\n" not in said
    assert says.replace("USED", places["USED"]) in said
    assert not new.exists()
    assert [p.name for p in used.iterdir()] == ["thesis.tex"]
    assert (used / "thesis.tex").read_text() == "precious"


@pytest.mark.parametrize(
    ("mix", "words", "says"),
    [
        (Mix(), ["--length", "9"], "--length is 8 in the run, 9 was given"),
        (Mix(), ["--length", "4,8"], "--length is 8 in the run, 4,8 was given"),
        (Mix(), ["--preset", "paper"], "--preset is quick in the run"),
        (Mix(), ["--seed", "3"], "--seed is 0"),
        (MANY, ["--length", "2..6"], "--length is 2..5 in the run, 2..6 was given"),
        (MANY, ["--length", "5"], "--length is 2..5 in the run, 5 was given"),
        (MANY, ["--weights", "1,2,1,1"], "--weights is 1,1,1,1 in the run, 1,2,1,1 was given"),
        (MANY, ["--length", "5,2", "--weights", "9,1"], "try --length 2,5"),
        (MANY, ["--curriculum", "0.6"], "--curriculum is 0.5 in the run, 0.6 was given"),
        (MANY, ["--length", "2..5", "--curriculum", "0"], "--curriculum is 0.5 in the run, 0 was"),
    ],
)
def test_resume_refuses_settings_that_contradict_the_run(mix, words, says, tmp_path, capsys):
    create(tmp_path / "run", choose("quick", mix=mix), 1, "cpu")
    before = (tmp_path / "run" / "config.json").read_text()
    assert run(["train", "--resume", "--out", str(tmp_path / "run"), *words]) == 2
    assert says in capsys.readouterr().err
    assert [path.name for path in (tmp_path / "run").iterdir()] == ["config.json"]
    assert (tmp_path / "run" / "config.json").read_text() == before


def test_resume_takes_the_settings_of_the_run_typed_again(tmp_path):
    config = choose("quick", mix=MANY)
    create(tmp_path, config, 1, "cpu")
    again = Train(length="2,3,4,5", weights="1,1,1,1", curriculum="0.5", model="gcn", resume=True)
    assert settings(again, tmp_path) == config


def test_resuming_a_finished_run_says_so_at_once_and_changes_nothing(
    fresh_run, monkeypatch, capsys
):
    (fresh_run / "summary.json").write_text("{}")
    monkeypatch.setattr("salpchain.training.trainer.resume", None)
    assert run(["train", "--resume", "--out", str(fresh_run)]) == 0
    said = capsys.readouterr()
    assert "is trained already: all 1,253,376 steps are done" in said.out
    assert f"salpchain evaluate {fresh_run}" in said.err and "compiling" not in said.err
    assert (fresh_run / "summary.json").read_text() == "{}"


def assert_resuming_says_one_line(run_folder, says, capsys):
    assert run(["train", "--resume", "--out", str(run_folder)]) == 2
    said = capsys.readouterr()
    assert said.out == "" and says in said.err and "\n" not in said.err.strip()


def test_a_damaged_checkpoint_is_named_before_anything_starts(fresh_run, capsys):
    (fresh_run / "checkpoint.safetensors").write_bytes(b"half a che")
    assert_resuming_says_one_line(fresh_run, "checkpoint.safetensors", capsys)


def test_a_run_of_a_newer_version_is_refused(fresh_run, capsys):
    config = json.loads((fresh_run / "config.json").read_text())
    (fresh_run / "config.json").write_text(json.dumps({**config, "format": 99}))
    assert_resuming_says_one_line(fresh_run, "newer salpchain", capsys)


def test_a_full_disk_is_one_line_and_leaves_no_half_file(tmp_path, monkeypatch, capsys, policy):
    import os

    def full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    out = tmp_path / "out"
    words = ["evaluate", "greedy", "--lengths", "2", "--trials", "1", "--out", str(out)]
    assert run(words) == 2
    assert f"no space left on device: {out / 'evaluation.csv'} (" in capsys.readouterr().err
    assert list(out.iterdir()) == []


@pytest.mark.slow
def test_evaluate_writes_both_files_in_the_stated_form(policy, tmp_path, capsys):
    out = tmp_path / "results"
    words = ["evaluate", str(policy), "--lengths", "2,3", "--trials", "3", "--out", str(out)]
    assert run(words) == 0
    summary = json.loads((out / "evaluation.json").read_text())
    assert {"policy", "time_limit", "seed", "lengths"} <= summary.keys()
    assert [row["length"] for row in summary["lengths"]] == [2, 3]
    for row in summary["lengths"]:
        assert row["trials"] == 3
        assert {"mean", "low", "high"} <= row["success"].keys()
        assert {"mean", "median", "iqm", "low", "high"} <= row["closed_fraction"].keys()
    rows = (out / "evaluation.csv").read_text().splitlines()
    assert len(rows) == 1 + 2 * 2 * 3  # both policies at both lengths


def test_results_of_a_name_leave_a_folder_that_is_called_so_alone(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for folder in ("any-length", "greedy", "eight"):
        Path(folder).mkdir()
    for name in ("any-length", "greedy"):
        assert default_out(name) == default_out(f"{name}.safetensors") == Path(f"evaluation-{name}")
    for folder in ("./any-length", "greedy/", "eight"):
        for policy in (folder, str(Path(folder) / "policy.safetensors")):
            assert default_out(policy) == Path(folder) / "evaluation"


@pytest.fixture
def twins(tmp_path):
    """Two run folders whose policies have one name and other weights."""
    for seed in (0, 1):
        card, run_folder = PolicyCard(name="gcn-mixed-8"), tmp_path / f"twin-{seed}"
        run_folder.mkdir()
        network = actor_critic(jr.key(seed), card.control, 22, 1, 8)
        save_policy(Policy(network, card), run_folder / "policy.safetensors")
    return tmp_path / "twin-0", tmp_path / "twin-1"


def content_of(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_results_of_another_policy_are_not_lost_whatever_it_is_called(twins, tmp_path, capsys):
    out = tmp_path / "out"
    words = ["evaluate", "--lengths", "2", "--trials", "1", "--out", str(out)]
    one, other = map(str, twins)
    assert run([*words, one]) == 0
    kept = content_of(out)
    for policy in (other, "approach"):
        capsys.readouterr()
        assert run([*words, policy]) == 2
        said = capsys.readouterr()
        assert said.out == "" and said.err.count("\n") == 1
        assert f"{out} holds results of gcn-mixed-8, " in said.err and "--overwrite" in said.err
        assert content_of(out) == kept
    assert run([*words, one]) == 0 and content_of(out) == kept
    assert run([*words, other, "--overwrite"]) == 0
    assert json.loads((out / "evaluation.json").read_text())["identity"] == identity(load(other))


def test_results_of_other_trials_are_not_lost(tmp_path, capsys):
    words = ["evaluate", "greedy", "--out", str(tmp_path)]
    assert run([*words, "--lengths", "2,3", "--trials", "2"]) == 0
    kept = content_of(tmp_path)
    for more, says in (
        (["--lengths", "2,3", "--trials", "1"], "trials 2 there, 1 asked for"),
        (["--lengths", "2", "--trials", "2"], "lengths 2,3 there, 2 asked for"),
        (["--lengths", "2,3", "--trials", "2", "--seed", "1"], "seed 0 there, 1 asked for"),
        (["--lengths", "2,3", "--trials", "2", "--time-limit", "fixed"], "time limit scaled there"),
    ):
        capsys.readouterr()
        assert run([*words, *more]) == 2
        said = capsys.readouterr().err
        assert says in said and "--overwrite" in said and said.count("\n") == 1
        assert content_of(tmp_path) == kept
    for content in ("[1]", "{}", "half a fi"):
        (tmp_path / "evaluation.json").write_text(content)
        assert run([*words, "--lengths", "2", "--trials", "1"]) == 2
        assert (tmp_path / "evaluation.json").read_text() == content
    assert run([*words, "--lengths", "2", "--trials", "1", "--overwrite"]) == 0
    assert len(json.loads((tmp_path / "evaluation.json").read_text())["lengths"]) == 1


def test_results_that_do_not_say_of_which_weights_they_are_are_kept(tmp_path, capsys):
    words = ["evaluate", "greedy", "--lengths", "2", "--trials", "1", "--out", str(tmp_path)]
    assert run(words) == 0
    old = json.loads((tmp_path / "evaluation.json").read_text())
    del old["identity"]
    (tmp_path / "evaluation.json").write_text(json.dumps(old))
    assert run(words) == 2
    assert "greedy, which does not say of which weights" in capsys.readouterr().err


def test_what_to_do_next_names_the_run_and_not_a_policy_that_is_called_so(capsys):
    rows = [{"length": 7}, {"length": 8}, {"length": 9}]
    share = {"mean": 0.96, "low": 0.9, "high": 0.984}
    summary = {"evaluation": {"trials": 60, "success": share, "lengths": rows}}
    for folder, typed in (("runs/eight", "runs/eight"), ("any-length", "./any-length")):
        _report({**summary, "steps": 8192, "seconds": 3.0}, Path(folder))
        said = capsys.readouterr()
        assert said.out == (
            "trained 8,192 steps in 3 s\n"
            "success 96.0 % [90, 98] of 60 episodes at 7..9 units (deterministic, 95 % interval)\n"
        )
        assert said.err == f"test it on other lengths with: salpchain evaluate {typed}\n"


def test_ctrl_c_in_an_evaluation_is_one_line_and_writes_nothing(tmp_path):
    words = ["evaluate", "greedy", "--lengths", "4:64:4", "--out", str(tmp_path / "out")]
    process = subprocess.Popen(
        [sys.executable, "-m", "salpchain", *words],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stderr is not None and process.stderr.readline().startswith("testing")
    process.send_signal(signal.SIGINT)
    said = process.communicate(timeout=120)[1]
    assert process.returncode == 130 and "Traceback" not in said
    assert [x for x in said.splitlines() if not x.startswith("testing")] == [
        "salpchain: interrupted"
    ]
    assert not any((tmp_path / "out").glob("*"))


def test_a_demo_asked_for_another_run_than_its_finished_one_is_refused(tmp_path, capsys):
    create(tmp_path / "demo" / "run", choose("quick"), 1, "cpu")
    (tmp_path / "demo" / "run" / "summary.json").write_text("{}")
    assert run(["demo", "--seed", "5", "--out", str(tmp_path / "demo")]) == 2
    assert "seed is 0 in the run, 5 was given" in capsys.readouterr().err
    assert [path.name for path in (tmp_path / "demo").iterdir()] == ["run"]


def test_a_swim_is_recorded_once_and_shown_three_ways(tmp_path, capsys):
    npz = tmp_path / "swim.npz"
    assert run(["rollout", "greedy", "--length", "2", "--seed", "3", "--out", str(npz)]) == 0
    assert "greedy, 2 units: goal" in capsys.readouterr().out
    for words in (["video", "--size", "64x64", "--speed", "50"], ["replay"]):
        out = tmp_path / f"{words[0]}{'.gif' if words[0] == 'video' else '.html'}"
        assert run([words[0], str(npz), *words[1:], "--out", str(out)]) == 0
        assert out.stat().st_size > 1000 and f"wrote {out}" in capsys.readouterr().out
    other = tmp_path / "other.npz"
    assert run(["rollout", "greedy", "--length", "2", "--seed", "4", "--out", str(other)]) == 0
    clash = ["video", "--compare", str(npz), str(other), "--out", str(tmp_path / "no.gif")]
    assert run(clash) == 2
    assert "needs swims of the same episode" in capsys.readouterr().err
    both = tmp_path / "both.html"
    assert run(["replay", str(npz), str(other), "--out", str(both)]) == 0
    for source in (npz, other):  # both are greedy's: files tell them apart
        assert f'"policy": "{source.name}"' in both.read_text()
    npz.write_bytes(npz.read_bytes()[:1000])
    assert run(["replay", str(npz), "--out", str(tmp_path / "no.html")]) == 2
    assert "cut short" in capsys.readouterr().err
    assert {path.name for path in tmp_path.iterdir()} == {
        "swim.npz", "other.npz", "video.gif", "replay.html", "both.html",
    }  # fmt: skip


def test_a_missing_extra_is_named():
    code = "import sys; sys.modules['uvicorn'] = None; from salpchain.cli.main import run; "
    code += "sys.exit(run(['live', '--port', '0']))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 2 and install_command("live") in done.stderr


def test_a_reader_that_has_seen_enough_is_no_error():
    command = [sys.executable, "-u", "-m", "salpchain.cli.main", "models"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None and process.stderr is not None
    process.stdout.close()
    assert process.stderr.read() == "" and process.wait() == 0
    process.stderr.close()


def test_models_prints_the_papers_count(capsys):
    assert run(["models", "--length", "8"]) == 0
    assert "102,804" in capsys.readouterr().out


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_a_page_with_an_example(command, capsys):
    assert run([command, "--help"]) == 0
    page = capsys.readouterr().out
    assert f"salpchain {command}" in page and "Example:" in page


def page(command, capsys):
    """The page of a command as running text."""
    assert run([command, "--help"]) == 0
    return " ".join(capsys.readouterr().out.replace("│", " ").split())


def test_the_pages_name_every_observation(capsys):
    for command in ("train", "models"):
        told = page(command, capsys)
        assert [name for name in OBSERVATIONS if name not in told] == []


def test_the_page_of_train_says_what_the_presets_take(capsys):
    told = page("train", capsys)
    steps = (*QUICK_STEPS, *QUICK_STEPS_OF["gt", "mixed"], choose("paper").steps)
    assert [number for number in steps if str(number) not in told] == []
    one, many = choose("quick"), choose("quick", mix=MANY)
    for config, lengths in ((one, "one length"), (many, "several lengths")):
        before = re.split(r"(body|table1|proximity) \(", told.split(f"; quick on {lengths}")[0])
        assert before[-2] == config.task.observation


def test_help_needs_no_jax():
    code = "import sys; from salpchain.cli.main import run; run(['--help']); run(['train', '-h']); "
    code += "sys.exit('jax' in sys.modules)"
    started = subprocess.run([sys.executable, "-c", code], capture_output=True, check=False)
    assert started.returncode == 0, started.stderr


def test_a_policy_file_is_data_and_loading_it_runs_no_code(policy, tmp_path):
    """Loads under an audit hook that forbids what a loader of code would do."""
    code = f"""
import sys
from salpchain import load
load({str(policy)!r})
def forbid(event, args):
    if event in ('pickle.find_class', 'exec', 'compile', 'os.system', 'subprocess.Popen'):
        raise SystemExit('forbidden: ' + event)
sys.addaudithook(forbid)
from salpchain.files import read_arrays
from pathlib import Path
read_arrays(Path({str(policy)!r}), 'policy', 1)
assert 'pickle' not in getattr(sys.modules['salpchain.files'], '__dict__')
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=False)
    assert done.returncode == 0, done.stderr


def test_a_file_that_exists_is_replaced_only_when_that_was_asked(twins, tmp_path, capsys):
    one, other = map(str, twins)
    rollout = ["rollout", one, "--length", "2", "--out", str(tmp_path / "swim.npz")]
    assert run(rollout) == 0
    swim = (tmp_path / "swim.npz").read_bytes()
    assert run(rollout) == 0  # the same again
    for words in (
        ["rollout", other, *rollout[2:]],
        [*rollout, "--seed", "1"],
        [*rollout, "--time-limit", "fixed"],
    ):
        capsys.readouterr()
        assert run(words) == 2
        said = capsys.readouterr()
        assert said.out == "" and "swim.npz exists: choose another --out, or add --o" in said.err
        assert (tmp_path / "swim.npz").read_bytes() == swim
    assert run(["rollout", other, *rollout[2:], "--overwrite"]) == 0
    assert Trajectory.load(tmp_path / "swim.npz").identity == identity(load(other))
    for words in (
        ["video", str(tmp_path / "swim.npz"), "--size", "64x64", "--speed", "50"],
        ["replay", str(tmp_path / "swim.npz")],
    ):
        out = tmp_path / f"mine.{'gif' if words[0] == 'video' else 'html'}"
        out.write_text("precious")
        assert run([*words, "--out", str(out)]) == 2 and out.read_text() == "precious"
        assert run([*words, "--out", str(out), "--overwrite"]) == 0
        assert out.stat().st_size > 1000


@pytest.mark.slow
def test_a_figure_that_would_show_something_else_is_kept(tmp_path, capsys):
    for trials in ("2", "3"):
        words = ["evaluate", "greedy", "--lengths", "2", "--trials", trials]
        assert run([*words, "--out", str(tmp_path / trials)]) == 0
    draw = ["figure", "zero-shot", "--out", str(tmp_path / "x.png")]
    assert run([*draw, str(tmp_path / "2")]) == 0
    drawn = {path: path.read_bytes() for path in tmp_path.glob("x.*")}
    assert run([*draw, str(tmp_path / "2")]) == 0
    assert run([*draw, str(tmp_path / "3")]) == 2
    assert "x.png exists: choose another --out" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in tmp_path.glob("x.*")} == drawn
    (tmp_path / "x.pdf").unlink()
    assert run([*draw, str(tmp_path / "2")]) == 0 and (tmp_path / "x.pdf").exists()
    assert run([*draw, str(tmp_path / "3"), "--overwrite"]) == 0
    assert (tmp_path / "x.png").read_bytes() != drawn[tmp_path / "x.png"]


def test_an_export_of_another_policy_is_kept(twins, tmp_path, capsys):
    out = tmp_path / "policy.safetensors"
    words = ["export", "--format", "torch", "--out", str(out)]
    assert run([*words, str(twins[0])]) == 0
    kept = out.read_bytes()
    assert run([*words, str(twins[0])]) == 0
    assert run([*words, str(twins[1])]) == 2 and out.read_bytes() == kept
    assert "add --overwrite" in capsys.readouterr().err
    assert run([*words, str(twins[1]), "--overwrite"]) == 0 and out.read_bytes() != kept


def test_a_demo_replaces_no_picture_of_a_folder_that_is_not_its_own(tmp_path, capsys):
    (tmp_path / "learning.png").write_text("precious")
    assert run(["demo", "--out", str(tmp_path)]) == 2
    assert "learning.png exists: choose another --out" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["learning.png"]


@pytest.mark.parametrize("name", [" ", "a/b", "a\\b", "..", "-x", "any-length", "greedy", "a\nb"])
def test_a_name_that_a_policy_cannot_have_is_refused(name, tmp_path, capsys):
    assert run(["train", "--out", str(tmp_path / "new"), f"--name={name}"]) == 2
    said = capsys.readouterr().err
    assert "error: name" in said and said.count("\n") == 1 and not (tmp_path / "new").exists()


def test_a_run_and_its_policy_have_the_name_that_was_given_and_resume_keeps_it(tmp_path, capsys):
    config = settings(Train(out="new", name="eight"), tmp_path / "new")
    assert config.policy_name == config.name == "eight" and choose("quick").name == ""
    create(tmp_path / "run", config, 1, "cpu")
    assert json.loads((tmp_path / "run" / "config.json").read_text())["config"]["name"] == "eight"
    words = ["train", "--resume", "--out", str(tmp_path / "run")]
    assert run([*words, "--name", "nine"]) == 2
    assert "--name is eight in the run, nine was given" in capsys.readouterr().err
    assert settings(Train(name="eight", resume=True), tmp_path / "run") == config
