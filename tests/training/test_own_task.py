"""A task in a module of a user's own: found, trained, kept with its settings, tested, refused."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from salpchain import plugins
from salpchain.cli.main import run
from salpchain.cli.settings import changed
from salpchain.controllers.storage import load
from salpchain.errors import InputError
from salpchain.evaluation.evaluate import evaluate
from salpchain.ranges import as_range
from salpchain.tasks.follow.config import FollowConfig
from salpchain.tasks.registry import as_config as task_config
from salpchain.tasks.registry import make_task
from salpchain.training.loop import new_learner
from salpchain.training.run_folder import read_config
from salpchain.training.settings import preset
from salpchain.training.trainer import train
from salpchain.world.presets import world_config
from tests.own import Hover, HoverConfig

SMALL = ["--length=2", "--steps=64", "--set=ppo.envs=4", "--set=ppo.rollout=8"]
SMALL += ["--set=ppo.minibatch=16", "--set=task.most_steps=8"]


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    out = tmp_path_factory.mktemp("own") / "run"
    own = ["--task=tests.own:Hover", "--set=task.softness=0.1"]
    assert run(["train", *SMALL, *own, f"--out={out}"]) == 0
    return out


@pytest.mark.slow
def test_a_run_keeps_the_task_and_its_settings(trained):
    config, _ = read_config(trained)
    assert config.task == HoverConfig(
        2, fine_weight=0.5, most_steps=8, name="tests.own:Hover", softness=0.1
    )
    card = load(trained).card
    assert card.trained_for == HoverConfig(name="tests.own:Hover", softness=0.1)
    log = (trained / "metrics.csv").read_text().splitlines()[0]
    assert "reward_near" in log and "reward_goal" not in log
    summary = json.loads((trained / "summary.json").read_text())
    assert 0 < summary["evaluation"]["drift"] < 1


def test_it_is_tested_at_what_it_was_trained_for_and_at_what_is_asked(trained, tmp_path):
    summary = evaluate(str(trained), 2, trials=2, out=tmp_path, time_limit="fixed")
    assert summary["task"] == "tests.own:Hover with softness 0.1"
    assert summary["measures"] == ["drift"]
    drift = summary["lengths"][0]["drift"]["mean"]
    assert 0 < drift < summary["baseline"]["lengths"][0]["drift"]["mean"] + 1
    with pytest.raises(InputError, match="other results of gcn-mixed-2: task"):
        evaluate(str(trained), 2, trials=2, out=tmp_path, time_limit="fixed", task="reach")


def test_a_class_is_as_good_as_its_name():
    assert task_config(Hover) == HoverConfig(name="tests.own:Hover")
    config = preset(length=4, task=Hover, settings={"task.softness": 0.2})
    assert isinstance(make_task(config.task), Hover) and config.task.softness == 0.2
    assert np.isclose(make_task(task_config("follow")).config.speed, 0.05)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--task=nowhere:Hover"], "task nowhere:Hover: there is no module nowhere"),
        (["--task=tests.own:Hower"], "tests.own has no Hower, it has"),
        (["--task=tests.own:minus"], "must be a class that is a salpchain.Task"),
        (["--task=folow"], "unknown task 'folow': choose one of reach, follow, dock, passage,"),
        (
            ["--task=follow", "--set=task.sped=0.1"],
            "unknown setting 'task.sped': perhaps task.speed",
        ),
        (["--task=follow", "--set=task.speed=fast"], "task.speed must be a finite number"),
        (["--task=follow", "--set=task.speed=7"], "task.speed must be a number, 0 to 0.5, got 7"),
        (["--task=follow", "--set=task.name=reach"], "--set task.name and --task contradict"),
    ],
)
def test_what_is_no_task_is_one_line(arguments, said, tmp_path, capsys):
    out = tmp_path / "run"
    assert run(["train", *SMALL, *arguments, f"--out={out}"]) == 2
    told = capsys.readouterr().err
    assert said in told and told.count("\n") == 1
    assert not out.exists()


def test_a_package_announces_a_task_by_an_entry_point(tmp_path, monkeypatch):
    about = tmp_path / "announced-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: announced\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[salpchain.tasks]\nhover = tests.own:Hover\n")
    monkeypatch.syspath_prepend(tmp_path)
    plugins._announced.cache_clear()
    try:
        assert isinstance(make_task(task_config("hover")), Hover)
        with pytest.raises(
            InputError, match=r"choose one of reach, follow, .*hover, or one of your"
        ):
            task_config("hovre")
    finally:
        plugins._announced.cache_clear()


@pytest.mark.parametrize(
    ("sets", "said"),
    [
        (["ppo.epochs=2"], "--set ppo.epochs is no setting of a test: give task.... or world...."),
        (["task.length=4"], "--set task.length is no setting of a test"),
        (["task.sped=1"], "unknown setting 'task.sped': perhaps task.speed"),
        (["world.current.speed=1:0"], "must have the lower end first"),
        (["task.speed"], "--set must be like"),
    ],
)
def test_what_a_test_cannot_set_is_one_line(sets, said):
    with pytest.raises(InputError, match=re.escape(said)):
        changed(world_config("still"), "follow", sets)


def test_a_test_sets_numbers_of_its_task_and_its_world():
    sets = ["task.speed=0.2", "world.current.speed=0:0.08"]
    world, task = changed(world_config("still"), "follow", sets)
    assert task == FollowConfig(speed=0.2)
    assert tuple(world.current.speed) == (0.0, 0.08)


def stop(_):
    raise RuntimeError


def test_training_in_python_takes_another_task_and_world(tmp_path):
    """Given beside the settings they take the place of theirs, in a run and in a loop alike."""
    ppo = {"ppo.envs": 4, "ppo.rollout": 8, "ppo.minibatch": 16, "task.contact": False}
    config = preset(length=2, settings={"steps": 64, **ppo})
    world = replace(world_config("current"), name="still")
    learner = new_learner(config, task=Hover, world=world)
    assert learner.config.task == HoverConfig(
        2, fine_weight=0.5, contact=False, name="tests.own:Hover"
    )
    assert learner.config.world == world
    with pytest.raises(RuntimeError):
        other = FollowConfig(length=2)
        train(config, tmp_path / "run", task=other, world="failing", on_stage=stop)
    kept, _ = read_config(tmp_path / "run")
    assert (kept.task.name, kept.world) == ("follow", world_config("failing"))
    faster = preset(world=world, settings={"world.current.speed": 0.5}).world
    assert faster.current == replace(world.current, speed=as_range(0.5))
    with pytest.raises(InputError, match="unknown world 'ruff'"):
        train(config, tmp_path / "other", world="ruff")
    assert not (tmp_path / "other").exists()
