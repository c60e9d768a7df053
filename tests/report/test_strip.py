"""Strips: what Matplotlib says of the words on them, and which moments they show."""

import itertools

import numpy as np
import pytest
from PIL import Image

from salpchain.errors import InputError
from salpchain.report.strip import MOMENTS, Layout, drawn
from salpchain.report.video import Film, write_video
from tests.report.swims import made, swim

LONG = "studies/a-very-long-name/of/some/run/that/was/given/by/its/folder"


def far_swim(policy="far"):
    """A swim of a minute to a target at 17 m, which it does not reach."""
    way = np.linspace(0, 11, 600)[:, None, None] * np.ones((600, 2, 2))
    target = [[12.0, 12.0], [12.07, 12.0]]
    return made(way, np.zeros((600, 2)), target, success=False, policy=policy)


SWIMS = {
    "one": [swim(8)],
    "two policies": [swim(8), swim(8, policy="other")],
    "lengths": [swim(n) for n in (4, 16, 64)],
    "far, and long names": [far_swim(LONG), swim(4, policy=LONG + "/other")],
    "alike": [swim(5), swim(5)],
}


def words(figure):
    return [(text.get_text(), text.get_window_extent()) for text in figure.texts]


@pytest.mark.parametrize("swims", SWIMS.values(), ids=SWIMS)
@pytest.mark.parametrize("size", [(64, 64), (200, 100), (320, 220), (640, 360)])
def test_no_two_words_overlap_and_all_are_on_the_strip(swims, size):
    figure = drawn(swims, *size)
    for (one, box), (other, other_box) in itertools.combinations(words(figure), 2):
        assert not box.overlaps(other_box), (one, other)
    for text, box in words(figure):
        assert box.x0 >= 0 and box.y0 >= 0, text
        assert box.x1 <= figure.bbox.width and box.y1 <= figure.bbox.height, text


def test_no_words_lie_on_the_water():
    figure, layout = drawn(SWIMS["lengths"], 320, 220), Layout(3, 320, 220)
    for row in range(3):
        for panel in layout.panels(row):
            for text, box in words(figure):
                above = box.y0 >= panel.y + panel.height or box.y1 <= panel.y
                assert above, text


def test_each_row_has_a_time_axis_of_its_own_from_its_start_to_its_end():
    swims = [swim(4, times=11), swim(8, times=101)]
    clocks = [text for text, _ in words(drawn(swims, 320, 220)) if text.endswith(" s")]
    times = [float(text.split()[0]) for text in clocks if not text.startswith("goal")]
    np.testing.assert_allclose(times, [*np.arange(0, 1.1, 0.2), *np.arange(0, 11, 2)])


def test_each_moment_tells_the_distance_at_its_time():
    one = far_swim()
    texts = [text for text, _ in words(drawn([one], 320, 220)) if text.endswith(" cm")]
    steps = [round(part * one.steps) for part in np.linspace(0, 1, MOMENTS)]
    apart = [float(text.removesuffix(" cm")) for text in texts]
    np.testing.assert_allclose(apart, 100 * one.distance[steps], atol=0.6)


@pytest.mark.parametrize(
    ("swims", "header", "captions"),
    [
        ("one", "made, 8 units", []),
        ("two policies", "8 units", ["made", "other"]),
        ("lengths", "made", ["4 units", "16 units", "64 units"]),
        ("alike", "made, 5 units", ["swim 1", "swim 2"]),
    ],
)
def test_the_header_says_what_rows_share_and_captions_what_tells_them_apart(
    swims, header, captions
):
    texts = [text for text, _ in words(drawn(SWIMS[swims], 320, 220))]
    assert header in texts
    assert [text for text in texts if text in captions] == captions


def test_the_rows_show_their_own_swims_and_their_moments_differ(tmp_path):
    path = write_video([swim(3), swim(9)], tmp_path / "x.png", Film(200, 100))
    layout = Layout(2, 200, 100)
    with Image.open(path) as image:
        assert image.size == layout.size
        pixels = np.asarray(image.convert("RGB")).astype(int)[::-1]
    seen = []
    for row in (0, 1):
        for box in layout.panels(row):
            low, left = round(box.y), round(box.x)
            seen.append(pixels[low : low + 100, left : left + 200])
    for one, other in itertools.combinations(seen, 2):
        assert np.abs(one - other).max() > 100


def test_a_strip_is_small_enough_for_a_page(tmp_path):
    path = write_video([swim(8), swim(16)], tmp_path / "x.png")
    assert path.stat().st_size < 300_000


def test_a_strip_of_too_many_pixels_is_refused_before_it_is_drawn(tmp_path):
    with pytest.raises(InputError, match="give a smaller size"):
        write_video([swim(3)] * 5, tmp_path / "x.png", Film(4096, 4096))
    assert list(tmp_path.iterdir()) == []
