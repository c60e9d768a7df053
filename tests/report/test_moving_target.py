"""Swims whose target moves: recorded, kept, told of and drawn with the target of each time."""

import base64
import json

import numpy as np
import pytest

import salpchain
from salpchain.cli.main import run
from salpchain.controllers.greedy import Greedy
from salpchain.evaluation.impossible import of_swims
from salpchain.evaluation.trajectory import Trajectory
from salpchain.report.canvas import Canvas
from salpchain.report.replay import packed
from salpchain.report.scene import Box, Scene
from salpchain.tasks.follow.config import FollowConfig

SPEED = 0.2  # m/s


@pytest.fixture(scope="module")
def swim():
    task = FollowConfig(speed=SPEED, most_steps=12)
    (one,) = salpchain.record(Greedy(), 2, time_limit="fixed", task=task)
    return one


def test_the_target_of_each_time_is_recorded_and_distances_are_to_it(swim):
    assert swim.task == "follow with speed 0.2" and swim.unusual == [swim.task]
    assert swim.target.shape == (13, 2, 2)
    way = np.linalg.norm(np.diff(swim.target.mean(axis=1), axis=0), axis=-1)
    np.testing.assert_allclose(way, SPEED * swim.dt, rtol=1e-3)
    last = np.linalg.norm(swim.unit_position[5] - swim.target[5], axis=-1).mean()
    assert swim.distance[5] == pytest.approx(last, rel=1e-6)
    assert of_swims([swim]) == ""


def test_a_file_keeps_it(swim, tmp_path):
    swim.save(tmp_path / "swim.npz")
    kept = Trajectory.load(tmp_path / "swim.npz")
    assert kept.task == swim.task
    np.testing.assert_array_equal(kept.target, swim.target)


class Spy(Canvas):
    """A canvas that keeps the lines that are drawn on it."""

    def __init__(self):
        super().__init__(320, 240)
        self.drawn = []

    def lines(self, lines, *how, **more):
        self.drawn += [np.asarray(line) for line in lines]
        super().lines(lines, *how, **more)


def test_a_video_draws_the_target_where_it_is(swim):
    scene = Scene(swim, Box(0.0, 0.0, 320.0, 240.0), "")
    for step in (0, 12):
        canvas = Spy()
        scene.draw_still(canvas)
        scene.draw(canvas, step * swim.dt)
        here = scene.at(swim.target[step])
        drawn = [one for one in canvas.drawn if one.shape == here.shape and np.allclose(one, here)]
        assert len(drawn) == 2  # its band and its line
        assert (here >= 0).all() and (here <= [320, 240]).all()


def test_a_page_has_the_target_of_each_time(swim):
    page = packed(swim)
    assert page["task"] == swim.task
    np.testing.assert_allclose(page["target"], swim.target[0], atol=1e-4)
    numbers = np.frombuffer(base64.b64decode(page["moving"]), "<i2")
    points = numbers.reshape(swim.target.shape) * page["grain"] + page["middle"]
    np.testing.assert_allclose(points, swim.target, atol=2e-4)
    json.dumps(page)


def test_another_task_is_another_episode(tmp_path, capsys):
    asked = ["rollout", "greedy", "--length=2", "--time-limit=fixed", f"--out={tmp_path}/swim.npz"]
    assert run([*asked, "--task=follow"]) == 0
    assert "greedy, 2 units, follow: swam after 51.2 s" in capsys.readouterr().out
    before = (tmp_path / "swim.npz").read_bytes()
    assert run(asked) == 2
    assert (tmp_path / "swim.npz").read_bytes() == before
