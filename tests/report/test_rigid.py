"""Pictures of chains of rigid links: in their own size, from hinge to hinge, at their own pace."""

from dataclasses import replace

import numpy as np
import pytest

from salpchain import Trajectory, record
from salpchain.controllers.greedy import Greedy
from salpchain.report.canvas import Canvas
from salpchain.report.replay import packed
from salpchain.report.scene import Box, Scene
from salpchain.report.shapes import jet_outlines, lines
from salpchain.report.video import DEFAULTS, paced
from salpchain.world.config import DynamicsConfig, WorldConfig
from tests.report.swims import swim

TIMES = 4.0  # longer than the paper's links


@pytest.fixture(scope="module")
def ground():
    world = WorldConfig(dynamics=DynamicsConfig(kind="landsalp"))
    return record(Greedy(), 3, time_limit="fixed", world=world)[0]


def enlarged(one):
    """The same swim of rigid links so much larger; its units point along them."""
    grown = {name: TIMES * getattr(one, name) for name in ("unit_position", "link_position")}
    sizes = {"unit_length": TIMES * one.unit_length, "unit_width": TIMES * one.unit_width}
    return replace(
        one, **grown, **sizes, target=TIMES * one.target, link_length=TIMES * one.link_length,
        mounts=np.zeros(one.length),
    )  # fmt: skip


def test_links_are_drawn_from_hinge_to_hinge_and_none_is_cut(ground):
    (line,) = lines(ground, ground.steps)
    assert np.linalg.norm(np.diff(line, axis=0), axis=1) == pytest.approx(0.272, abs=1e-5)
    assert (line[:-1] + line[1:]) / 2 == pytest.approx(ground.unit_position[-1], abs=1e-4)
    assert not ground.parted.any()


def test_a_file_keeps_how_long_its_links_are(ground, tmp_path):
    ground.save(tmp_path / "x.npz")
    again = Trajectory.load(tmp_path / "x.npz")
    assert again.scale == pytest.approx(0.272 / 0.07) and again.is_rigid
    page = packed(again)
    assert page["link"] == pytest.approx(0.272) and len(page["mounts"]) == 3
    assert "mounts" not in packed(swim(3))


def test_the_goals_band_grows_with_the_links():
    def still(one):
        canvas = Canvas(320, 200)
        Scene(one, Box(0.0, 0.0, 320.0, 200.0), "").draw_still(canvas)
        return canvas.copy().astype(int)

    one = swim(4)
    assert still(one).std() > 1
    assert np.abs(still(one) - still(enlarged(one))).max() <= 2


def test_jets_grow_with_the_links():
    place = np.zeros((2, 2)), np.array([0.3, 2.0]), np.array([1.0, -0.4])
    small = jet_outlines(*place, unit=(0.04, 0.05))
    large = jet_outlines(*place, unit=(0.04 * TIMES, 0.05 * TIMES), scale=TIMES)
    np.testing.assert_allclose(large, TIMES * small)


def test_a_film_shows_as_many_control_steps_in_a_second(ground):
    film = DEFAULTS[".gif"]
    assert paced(film, [swim(3)]).speed == film.speed
    assert paced(film, [ground]).speed / ground.dt == pytest.approx(film.speed / 0.1)
