"""Every setting of a training, from the command line, from a file, and in `config.json`."""

import json
import re
from pathlib import Path

import pytest

import salpchain
from salpchain.cli.main import run
from salpchain.cli.train import Train, settings
from salpchain.errors import InputError
from salpchain.ranges import Range
from salpchain.training.config import TrainConfig
from salpchain.training.run_folder import create, read_config
from salpchain.training.settings import SETTINGS, changed, flat, overlay

# Another value than quick's of every setting, what else it needs, and one that cannot be.
VALUES = {
    "task.length": ("12", 12, (), "1"),
    "task.observation": ("table1", "table1", (), "sonar"),
    "task.action": ("pair", "pair", (), "jump"),
    "task.time_limit": ("scaled", "scaled", (), "never"),
    "task.fence": ("true", True, (), "high"),
    "task.contact": ("False", False, (), "0.5"),
    "task.fine_weight": ("0.25", 0.25, (), "-1"),
    "task.time_weight": ("0.02", 0.02, (), "-1"),
    "task.folded": ("0.1", 0.1, (), "1.5"),
    "task.stalled": ("0.2", 0.2, (), "2"),
    "task.tolerance": ("0.03", 0.03, (), "0"),
    "task.most_steps": ("100", 100, (), "-1"),
    "control.model": ("gt", "gt", (), "gnn"),
    "control.graph": ("full", "full", (), "ring"),
    "control.shared_log_std": ("false", False, (), "1"),
    "control.improved": ("true", True, (), "very"),
    "control.depth": ("4", 4, (), "99"),
    "control.critic": ("around", "around", (), "everything"),
    "control.memory": ("true", True, (), "much"),
    "control.by_jet": ("true", True, ("task.observation=jets",), "yes"),
    "ppo.envs": ("512", 512, (), "0"),
    "ppo.rollout": ("64", 64, (), "2.5"),
    "ppo.minibatch": ("1024", 1024, (), "1000"),
    "ppo.epochs": ("3", 3, (), "-3"),
    "ppo.learning_rate": ("1e-3", 1e-3, (), "inf"),
    "ppo.final_rate": ("0.5", 0.5, (), "1.01"),
    "ppo.clip": ("0.3", 0.3, (), "nan"),
    "ppo.ratio": ("chain", "chain", (), "golden"),
    "ppo.credit": ("unit", "unit", (), "gold"),
    "ppo.max_grad_norm": ("1", 1.0, (), "0"),
    "ppo.gamma": ("0.9", 0.9, (), "1.1"),
    "ppo.lam": ("0.8", 0.8, (), "-0.1"),
    "ppo.entropy": ("0.01", 0.01, (), "-0.01"),
    "ppo.final_entropy": ("1", 1.0, (), "7"),
    "ppo.value_weight": ("1.5", 1.5, (), "-1"),
    "mix.lengths": ("4..6", (4, 5, 6), (), "1,2"),
    "mix.weights": ("1,2", (1.0, 2.0), ("mix.lengths=4,8",), "nan"),
    "mix.grow": ("0.9", 0.9, ("mix.lengths=4,8",), "90"),
    "mix.roughen": ("0.8", 0.8, ("world.name=rough",), "80"),
    "task.name": ("follow", "follow", (), "folow"),
    "world.name": ("rough", "rough", (), "tough"),
    "world.dynamics.mass": ("0.8:1.2", (0.8, 1.2), (), "0"),
    "world.dynamics.drag": ("1.1", (1.1, 1.1), (), "9"),
    "world.dynamics.stiffness": ("0.5:2", (0.5, 2.0), (), "2:0.5"),
    "world.dynamics.substeps": ("2", 2, (), "0"),
    "world.dynamics.kind": ("landsalp", "landsalp", (), "land"),
    "world.dynamics.across": ("10", 10.0, (), "0"),
    "world.dynamics.spring": ("0.15", 0.15, (), "-1"),
    "world.current.speed": ("0:0.08", (0.0, 0.08), (), "-1"),
    "world.current.shear": ("0.1", (0.1, 0.1), (), "nan"),
    "world.current.vortex": ("0.05", (0.05, 0.05), (), "7"),
    "world.current.vortex_radius": ("0.3", (0.3, 0.3), (), "0"),
    "world.current.wander": ("0.01", (0.01, 0.01), (), "2"),
    "world.current.relaxation": ("5", (5.0, 5.0), (), "0"),
    "world.thrusters.dead": ("0:0.5", (0.0, 0.5), (), "1.5"),
    "world.thrusters.failing": ("0.25", (0.25, 0.25), (), "a:b"),
    "world.thrusters.gain": ("0.6:1", (0.6, 1.0), (), "3"),
    "world.thrusters.lag": ("0.2", (0.2, 0.2), (), "-1"),
    "world.thrusters.one_sided": ("true", True, (), "left"),
    "world.thrusters.one_sided_share": (
        "0.5",
        0.5,
        ("world.thrusters.one_sided=true",),
        "2",
    ),
    "world.sensing.position": ("0:0.01", (0.0, 0.01), (), "-1"),
    "world.sensing.angle": ("0.1", (0.1, 0.1), (), "1:2:3"),
    "world.sensing.position_bias": ("0.02", (0.02, 0.02), (), "-1"),
    "world.sensing.angle_bias": ("0.02", (0.02, 0.02), (), "inf"),
    "world.sensing.dropped": ("0.05", (0.05, 0.05), (), "2"),
    "world.sensing.dropped_steps": ("10", (10.0, 10.0), (), "0.5"),
    "world.sensing.stuck": ("0.05", (0.05, 0.05), (), "2"),
    "world.sensing.stuck_steps": ("1:3", (1.0, 3.0), (), "0.5"),
    "world.sensing.delay": ("0:3", (0.0, 3.0), (), "99"),
    "world.sensing.action_delay": ("1", (1.0, 1.0), (), "99"),
    "world.sensing.repeat": ("2", (2.0, 2.0), (), "99"),
    "world.obstacles.posts": ("2:5", (2.0, 5.0), (), "-1"),
    "world.obstacles.post_radius": ("0.1", (0.1, 0.1), (), "0"),
    "world.obstacles.walls": ("3", (3.0, 3.0), (), "99"),
    "world.obstacles.wall_length": ("0.5:1", (0.5, 1.0), (), "0"),
    "world.obstacles.wall_angle": ("0", (0.0, 0.0), (), "7"),
    "world.obstacles.along": ("0.5", (0.5, 0.5), (), "9"),
    "world.obstacles.aside": ("0.3:1", (0.3, 1.0), (), "-1"),
    "world.obstacles.room": ("0.5", (0.5, 0.5), (), "1:0"),
    "world.spared": ("0:1", (0.0, 1.0), (), "1.5"),
    "preset": ("paper", "paper", (), "slow"),
    "steps": ("3e4", 30_000, (), "0"),
    "seed": ("7", 7, (), "-7"),
    "evaluations": ("4", 4, (), "-1"),
    "name": ("eight", "eight", (), "any-length"),
    "start": ("any-length", "any-length", (), "no-such-run"),
    "fresh_spread": ("true", True, (), "1"),
}


@pytest.fixture
def new(tmp_path):
    return str(tmp_path / "new")


def asked(tmp_path, *sets, **options):
    return settings(Train(out="new", set=sets, **options), tmp_path / "new")


def test_no_setting_is_missing_here():
    assert VALUES.keys() == SETTINGS.keys()


@pytest.mark.parametrize("path", SETTINGS)
def test_a_setting_is_set_recorded_and_read_again(path, tmp_path):
    text, value, needs, _ = VALUES[path]
    config = asked(tmp_path, f"{path}={text}", *needs)
    assert flat(config)[path] == value != flat(salpchain.preset())[path]
    create(tmp_path / "run", config, 1, "cpu")
    assert read_config(tmp_path / "run")[0] == config
    content = json.loads((tmp_path / "run" / "config.json").read_text())
    recorded = content["config"]
    for name in path.split("."):
        recorded = recorded[name]
    assert recorded == (list(value) if isinstance(value, tuple) else value)
    again = asked(tmp_path, config=str(tmp_path / "run"))
    assert again == config


@pytest.mark.parametrize("path", SETTINGS)
def test_a_wrong_value_of_a_setting_is_one_line_and_makes_nothing(path, tmp_path, new, capsys):
    _, _, needs, wrong = VALUES[path]
    words = [f"--set={one}" for one in (f"{path}={wrong}", *needs)]
    assert run(["train", "--out", new, *words]) == 2
    said = capsys.readouterr().err.strip()
    assert said.startswith("salpchain: error:") and "\n" not in said
    choice = said.startswith("salpchain: error: unknown ")
    name = path.removesuffix(".name").rpartition(".")[2] if choice else path
    assert name in said.replace(" ", "_") and wrong.rstrip("0") in said
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("path", SETTINGS)
def test_a_setting_of_another_type_is_refused_in_files_and_in_python(path, tmp_path, new, capsys):
    for wrong in ({"a": 1}, None, [[1]], "fast" if SETTINGS[path] is not str else 3):
        with pytest.raises(InputError, match=path):
            salpchain.preset(settings={path: wrong})
    content = {"a": 1}
    for name in reversed(path.split(".")):
        content = {name: content}
    (tmp_path / "my.json").write_text(json.dumps(content))
    assert run(["train", "--out", new, "--config", str(tmp_path / "my.json")]) == 2
    said = capsys.readouterr().err
    assert f"my.json: {path} must be" in said and said.count("\n") == 1


BAD = [
    (["--set", "ppo.learnin_rate=1"], "unknown setting 'ppo.learnin_rate': perhaps ppo.learning_r"),
    (["--set", "learning_rate=1"], "perhaps ppo.learning_rate"),
    (["--set", "PPO.Gamma=1"], "perhaps ppo.gamma"),
    (
        ["--set", "world.current=0.1"],
        "world.current has several settings: world.current.speed, w",
    ),
    (["--set", "world.sensing.delay=1.5"], "world.sensing.delay must be whole control steps, got"),
    (["--set", "ppo.gamma"], "--set must be like ppo.learning_rate=1e-3, got 'ppo.gamma'"),
    (["--set", "ppo.envs="], "ppo.envs must be a whole number, got ''"),
    (["--set", "seed=1", "--set", "seed=1"], "--set seed is given twice"),
    (["--set", "seed=1", "--seed", "2"], "--set seed and --seed contradict each other"),
    (["--set", "preset=paper", "--preset", "quick"], "--set preset and --preset contradict"),
    (["--set", "foo=1"], "unknown setting 'foo': docs/settings.md lists all"),
    (["--set", "ppo.lr=1"], "unknown setting 'ppo.lr': docs/settings.md lists all"),
    (
        ["--set", "mix.lengths=4,8", "--set", "task.length=16"],
        "--set task.length=16 and --set mix.lengths=4,8 contradict each other",
    ),
    (
        ["--length", "2", "--set", "mix.lengths=2,3"],
        "--length 2 and --set mix.lengths=2,3 contradict each other",
    ),
    (
        ["--length", "4..16", "--set", "task.length=8"],
        "--set task.length=8 and --length 4..16 contradict each other",
    ),
    (["--config", "HERE/both.toml"], "task.length must be the longest of mix.lengths, 8, got 4"),
    (["--config", "HERE/range.toml"], "ppo.learning_rate must be positive, got -1"),
    (["--set", "control.model=mlp", "--set", "control.graph=full"], "an mlp has no graph"),
    (["--set", "control.model=mlp", "--graph", "full"], "an mlp has no graph"),
    (["--set", "ppo.envs=1000000", "--set", "ppo.rollout=1000"], "at most 100,000,000"),
    (["--config", "HERE/missing.toml"], "no such file: HERE/missing.toml"),
    (["--config", "HERE"], "HERE is not a run folder: it has no config.json (give"),
    (["--config", "HERE/bad.toml"], "not valid TOML"),
    (["--config", "HERE/bad.json"], "not valid JSON"),
    (["--config", "HERE/list.json"], "holds no settings"),
    (["--config", "HERE/evaluation.json"], "is the result of an evaluation, not settings: give a"),
    (["--config", "HERE/summary.json"], "is the summary of a run, not settings: give a run's con"),
    (["--config", "HERE/metrics.csv"], "not valid JSON"),
    (["--config", "HERE/metrics.csv"], "give a run's config.json or its folder, or a TOML"),
    (["--config", "HERE/odd.toml"], "odd.toml: unknown setting 'ppo.learn_rate': perhaps ppo.le"),
    (["--config", "HERE/flat.toml"], "flat.toml: ppo must be a table, got 3"),
    (["--config", "HERE/newer.json"], "was made by a newer salpchain"),
    (["--config", "HERE/paper.toml", "--preset", "quick"], "says preset paper, quick was given"),
]


@pytest.mark.parametrize(("words", "says"), BAD, ids=lambda x: " ".join(x) if x is list else "")
def test_bad_settings_are_refused_in_one_line(words, says, tmp_path, new, capsys):
    files = {
        "bad.toml": "[ppo\n",
        "bad.json": "{",
        "list.json": "[1]",
        "evaluation.json": '{"policy": "a", "task": "reach", "seed": 0, "lengths": []}',
        "summary.json": '{"steps": 1, "seed": 0, "evaluation": {}}',
        "metrics.csv": "iteration,steps\n1,2\n",
        "odd.toml": "[ppo]\nlearn_rate = 1\n",
        "flat.toml": "ppo = 3\n",
        "both.toml": "task.length = 4\nmix.lengths = [4, 8]\n",
        "range.toml": "ppo.learning_rate = -1.0\n",
        "newer.json": '{"format": 99, "config": {}}',
        "paper.toml": 'preset = "paper"\n',
    }
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    words = [word.replace("HERE", str(tmp_path)) for word in words]
    assert run(["train", "--out", new, *words]) == 2
    printed = capsys.readouterr()
    assert printed.out == "" and printed.err.count("\n") == 1
    assert says.replace("HERE", str(tmp_path)) in printed.err
    assert {path.name for path in tmp_path.iterdir()} == set(files)


def test_a_file_stands_above_the_preset_and_the_command_line_above_the_file(tmp_path):
    file = tmp_path / "my.toml"
    file.write_text('preset = "paper"\nsteps = 5000\n[ppo]\ngamma = 0.9\nlam = 0.8\n')
    paper = salpchain.preset("paper")
    config = asked(tmp_path, "ppo.gamma=0.5", config=str(file), seed="3")
    assert (config.ppo.gamma, config.ppo.lam, config.ppo.epochs) == (0.5, 0.8, paper.ppo.epochs)
    assert (config.steps, config.seed, config.preset) == (5000, 3, "paper")
    assert changed(config) == ["ppo.gamma", "ppo.lam", "steps"]


def test_a_preset_takes_the_model_and_the_lengths_of_settings_into_account(tmp_path):
    sets = ("control.model=gt", "task.length=16")
    assert asked(tmp_path, *sets) == asked(tmp_path, model="gt", length="16")
    assert asked(tmp_path, "mix.lengths=4..8") == asked(tmp_path, length="4..8")
    assert changed(asked(tmp_path, *sets, "control.graph=full", "seed=3")) == []


def test_new_lengths_replace_all_that_a_file_says_of_lengths():
    below = {"mix.lengths": (4, 8), "mix.weights": (1.0, 2.0), "mix.grow": 0.5, "task.length": 8}
    one = overlay(below, {"task.length": 5})
    assert one == {"mix.lengths": (), "mix.weights": (), "mix.grow": 0.0, "task.length": 5}
    assert overlay(below, {"mix.lengths": (2, 9)})["task.length"] == 9
    assert overlay(below, {"seed": 1}) == {**below, "seed": 1}


def test_a_setting_that_rules_out_a_preset_may_be_changed_with_it(tmp_path):
    """Alone, the paper's log-std for each unit serves one length only."""
    config = asked(tmp_path, "control.shared_log_std=true", preset="paper", length="4,8")
    assert config.lengths == (4, 8) and config.control.shared_log_std


def test_resume_refuses_a_setting_that_contradicts_the_run(tmp_path, capsys):
    create(tmp_path / "run", salpchain.preset(), 1, "cpu")
    before = (tmp_path / "run" / "config.json").read_bytes()
    (tmp_path / "my.toml").write_text("[ppo]\nclip = 0.3\n")
    words = ["train", "--resume", "--out", str(tmp_path / "run")]
    assert run([*words, "--set", "ppo.gamma=0.5"]) == 2
    assert "ppo.gamma is 0.99 in the run, 0.5 was given" in capsys.readouterr().err
    assert run([*words, "--config", str(tmp_path / "my.toml")]) == 2
    assert "ppo.clip is 0.2 in the run, 0.3 was given" in capsys.readouterr().err
    assert (tmp_path / "run" / "config.json").read_bytes() == before
    again = Train(set=("ppo.gamma=0.99",), config=str(tmp_path / "run"), resume=True)
    assert settings(again, tmp_path / "run") == salpchain.preset()


def test_a_plain_config_is_changed_from_no_preset():
    assert changed(TrainConfig(preset="custom")) == []


def test_the_page_of_settings_lists_each_with_its_value_in_quick():
    page = (Path(__file__).parent.parent.parent / "docs" / "settings.md").read_text()
    rows = dict(re.findall(r"^\| `([\w.]+)` \| [\w ]+ \| (\S+) \| \S.+ \|$", page, re.MULTILINE))
    assert list(rows) == list(SETTINGS)
    for path, value in flat(salpchain.preset()).items():
        plain = isinstance(value, str | float | Range)
        shown = str(value) or '""' if plain else json.dumps(value)
        assert rows[path] in (shown, f"{value:.4f}" if isinstance(value, float) else shown)


def test_the_example_of_a_file_on_the_page_of_settings_is_one(tmp_path):
    page = (Path(__file__).parent.parent.parent / "docs" / "settings.md").read_text()
    (tmp_path / "mine.toml").write_text(re.findall(r"```toml\n(.*?)```", page, re.DOTALL)[0])
    config = asked(tmp_path, config=str(tmp_path / "mine.toml"))
    assert changed(config) == ["ppo.learning_rate", "steps"] and config.task.length == 12


def test_a_demo_trains_with_settings(tmp_path, capsys):
    words = ["demo", "--out", str(tmp_path / "demo"), "--set"]
    assert run([*words, "ppo.gama=1"]) == 2
    assert "perhaps ppo.gamma" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
