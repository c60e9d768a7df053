import matplotlib.image
import numpy as np
import pytest

from salpchain.errors import InputError
from salpchain.report import picture as module
from salpchain.report.picture import chains_picture
from tests.report.swims import made, swim


def test_a_picture_of_several_lengths_shows_water_and_every_colour_of_the_chain(tmp_path):
    path = chains_picture([swim(n) for n in (4, 8, 16)], tmp_path / "made" / "chains.pdf")
    assert path == tmp_path / "made" / "chains.png"
    assert 20_000 < path.stat().st_size < 3_000_000
    pixels = (255 * matplotlib.image.imread(path)[..., :3]).astype(int)
    assert pixels.shape[1] == 2000
    for colour in module.PLACES(np.linspace(0, 1, 4))[:, :3]:
        assert (np.abs(pixels - 255 * colour).max(axis=-1) < 4).sum() > 100


@pytest.mark.parametrize("bearing", [0.0, 1.0, 2.5, -2.0])
def test_every_swim_leads_to_the_right_within_its_rectangle(bearing):
    one = swim(6, bearing)
    view = module._view(one)
    points = one.unit_position @ view.turn.T
    assert np.allclose(view.turn @ view.turn.T, np.eye(2))
    assert points[-1, :, 0].mean() > points[0, :, 0].mean()
    assert np.allclose(points[-1, :, 1].mean(), points[0, :, 1].mean(), atol=0.01)
    assert (points >= view.low).all() and (points <= view.low + view.size).all()
    assert module.SHAPES[0] <= view.shape <= module.SHAPES[1]


def test_all_swims_are_shown_once_and_in_order():
    views = [module._view(swim(n)) for n in (4, 8, 16, 32, 64)]
    for rows in (1, 2, 3):
        lines = module._lines(views, rows)
        assert [view.swim.length for line in lines for view in line] == [4, 8, 16, 32, 64]


def test_poses_shown_are_equal_parts_of_the_way():
    still_first = np.concatenate([np.zeros((30, 2, 2)), swim(2).unit_position])
    times = [time for time, _ in module._moments(still_first)]
    assert times[0] == 0 and times[-1] == len(still_first) - 1
    np.testing.assert_allclose(np.diff(times[1:]), np.diff(times[1:]).mean(), atol=1)


def test_a_chain_that_never_moved_can_be_drawn(tmp_path):
    still = made(np.zeros((1, 2, 2)), np.zeros((1, 2)), np.ones((2, 2)), success=False)
    assert chains_picture([still], tmp_path / "x").stat().st_size > 5_000


def test_no_swims_is_an_error(tmp_path):
    with pytest.raises(InputError, match="swims must have at least one"):
        chains_picture([], tmp_path / "x")
