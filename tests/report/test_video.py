"""Videos: what is in the files, decoded again, and what is drawn where."""

import itertools
import sys
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from salpchain.errors import InputError
from salpchain.evaluation.surroundings import Surroundings
from salpchain.evaluation.trajectory import Trajectory
from salpchain.report.canvas import Canvas, text_width
from salpchain.report.scene import INK, STONE, Box, Scene
from salpchain.report.shapes import (
    jet_outlines,
    jet_size,
    place_colours,
    round_length,
    unit_outlines,
)
from salpchain.report.video import (
    COLOURS,
    DEFAULTS,
    Film,
    Picture,
    check_suffix,
    frames,
    layout,
    num_frames,
    write_video,
)
from tests.report.swims import made, swim

SMALL = Film(320, 180, 10.0, 2.0)


def quiet(_):
    pass


def near(pixels, colour, apart=12):
    """How many pixels have a colour (in [0, 1])."""
    return int((np.abs(pixels[..., :3].astype(int) - 255 * np.array(colour)).max(-1) < apart).sum())


def test_an_mp4_holds_every_frame_in_the_stated_size_and_rate(tmp_path):
    import av

    one, told = swim(5), []
    path = write_video([one], tmp_path / "x.mp4", SMALL, told.append)
    with av.open(path) as file:
        stream = file.streams.video[0]
        decoded = [frame.to_ndarray(format="rgb24") for frame in file.decode(stream)]
        assert (stream.width, stream.height, stream.average_rate) == (320, 180, 10)
        assert stream.codec_context.name == "h264" and stream.pix_fmt == "yuv420p"
    assert len(decoded) == num_frames([one], SMALL) == int(np.ceil((3.9 / 2 + 1) * 10)) + 1
    drawn = next(frames([one], SMALL))[..., :3].astype(int)
    assert np.abs(decoded[0].astype(int) - drawn).mean() < 4
    assert np.abs(decoded[-1].astype(int) - decoded[0]).max() > 100
    assert told[0] == 0 and told[-1] == 1 and told == sorted(told)
    assert len(told) > num_frames([one], SMALL)


def test_progress_moves_while_the_frames_of_a_gif_get_their_colours(tmp_path):
    one, told = swim(5), []
    write_video([one], tmp_path / "x.gif", SMALL, told.append)
    assert told == sorted(told) and told[-1] == 1
    assert len([share for share in told if share >= 0.5]) > num_frames([one], SMALL)


def test_a_post_stands_where_it_is_water_streaks_move_and_the_dead_turn_grey():
    still = swim(3, bearing=0.0)
    gain = np.ones((39, 3))
    gain[20:, 1] = 0.0
    water = np.full((1, 1, 1, 2), 0.1)
    post = np.array([[0.3, 0.3, 0.05]])
    around = Surroundings(posts=post, gain=gain, water=water)
    scene = Scene(replace(still, around=around), Box(0.0, 0.0, 640.0, 360.0), "")
    shown = {}
    for time in (1.0, 2.5):
        canvas = Canvas(640, 360)
        scene.draw_still(canvas)
        scene.draw(canvas, time)
        shown[time] = canvas.copy()
    x, y = np.round(scene.at(post[0, :2] + [0.04, 0.0])).astype(int)
    assert near(shown[1.0][359 - y : 360 - y, x : x + 1], STONE) == 1
    for time, crossed in ((1.0, False), (2.5, True)):
        x, y = np.round(scene.at(still.unit_position[round(10 * time), 1])).astype(int)
        assert (near(shown[time][357 - y : 362 - y, x - 2 : x + 3], INK, 30) > 0) == crossed
    corner = [pixels[:120, :120].astype(int) for pixels in shown.values()]
    assert np.abs(corner[0] - corner[1]).max() > 20


def test_a_gif_goes_round_for_ever(tmp_path):
    path = write_video([swim(3, times=9)], tmp_path / "x.gif", SMALL, quiet)
    with Image.open(path) as image:
        assert image.info["loop"] == 0
        shown = [image.seek(index) or image.info["duration"] for index in range(image.n_frames)]
        # frames in which nothing changes are one that stays longer
        assert sum(shown) == 100 * num_frames([swim(3, times=9)], SMALL)
        assert shown[:3] == [100, 100, 100]
        assert len(image.convert("RGB").getcolors(10**6)) <= COLOURS


def test_a_gif_keeps_the_colours_of_chains_that_are_few_of_its_pixels(tmp_path):
    swims = [swim(n, times=20) for n in (8, 40)]
    path = write_video(swims, tmp_path / "x.gif", Film(640, 360, 10.0, 8.0), quiet)
    with Image.open(path) as image:
        pixels = np.asarray(image.convert("RGB"))
    for colour in place_colours(6):
        assert near(pixels, colour, apart=30) > 10


@pytest.mark.parametrize("film", [Film(320, 180), Film(640, 360), Film(1280, 720)])
def test_words_of_a_panel_never_run_together(film, monkeypatch):
    """Not even at 64 units, whose distances have more digits, nor with long names."""
    words = []

    def text(_, x, y, line, size, colour, bold=False, right=False):
        width = text_width(line, size, bold)
        words.append((line, x - width if right else x, y, x if right else x + width, y + size))

    monkeypatch.setattr(Canvas, "text", text)
    far = made(
        np.linspace(0, 12, 600)[:, None, None] * np.ones((600, 2, 2)), np.zeros((600, 2)),
        np.array([[12, 12], [12.07, 12]]), policy="studies/a-very-long-name/of/some/run" * 3,
    )  # fmt: skip
    for count in (1, 2, 5):
        words.clear()
        Picture([far] * count, film).at(60.0)
        assert len(words) >= 6 * count
        for one, other in itertools.combinations(words, 2):
            apart = one[1] >= other[3] or other[1] >= one[3] or one[2] >= other[4]
            assert apart or other[2] >= one[4], (one, other)
        assert all(left >= 0 and right <= film.width for _, left, _, right, _ in words)


def test_a_chain_too_far_away_for_boxes_is_still_seen_in_its_colours():
    pixels = Picture([swim(64)], Film(320, 180)).at(2.0)
    for colour in place_colours(6):
        assert near(pixels, colour, apart=40) >= 5


def test_every_unit_is_seen_in_the_colour_of_its_place_where_it_is():
    one = swim(6)
    picture = Picture([one], Film(960, 540))
    scene = Scene(one, Box(0.0, 0.0, 960.0, 540.0), "words")
    for time in (0.0, 2.0):
        pixels = picture.at(time)
        index = round(time / one.dt)
        for place, colour in zip(scene.at(one.unit_position[index]), place_colours(6), strict=True):
            x, y = round(place[0]), 540 - round(place[1])
            # the middle of a unit shines
            assert near(pixels[y - 8 : y + 8, x - 8 : x + 8], colour + 0.18 * (1 - colour)) > 20


def test_between_two_steps_a_unit_is_between_its_two_places():
    def middle(time):
        pixels = picture.at(time)
        colour = place_colours(2)[0]
        mask = np.abs(pixels[..., :3] - 255 * (colour + 0.18 * (1 - colour))).max(-1) < 12
        return np.argwhere(mask).mean(axis=0)

    # 2 cm per step, over few steps, so that a step is many pixels
    picture = Picture([swim(2, times=6)], Film(640, 360))
    start, half, end = middle(0.0), middle(0.05), middle(0.1)
    np.testing.assert_allclose(half, (start + end) / 2, atol=1.0)
    assert np.abs(end - start).max() > 10


def test_the_same_scene_in_twice_the_pixels_is_the_same_scene_sharper():
    one = swim(4)
    small, large = (Picture([one], Film(k * 640, k * 360)).at(1.0) for k in (1, 2))
    halved = large.reshape(360, 2, 640, 2, 4).mean(axis=(1, 3))
    inside = (slice(80, 320), slice(10, 630))  # words have sizes of their own
    assert np.abs(halved[inside] - small[inside].astype(float)).mean() < 3


def test_jets_leave_opposite_to_the_push_and_grow_with_the_thrust():
    position, angle = np.zeros((3, 2)), np.array([0.0, 0.0, np.pi / 2])
    jets = jet_outlines(position, angle, np.array([1.0, -0.5, 1.0]))
    assert jets[0, :, 1].min() < -0.09 and jets[0, :, 1].max() < 0
    assert 0.06 < jets[1, :, 1].max() < 0.09 and jets[1, :, 1].min() > 0
    assert jets[2, :, 0].max() > 0.09 and jets[2, :, 0].min() > 0


def test_a_small_thrust_has_a_jet_that_is_seen_and_no_thrust_has_none():
    thrust = np.array([0.0, 0.001, 0.01, -0.1, 0.5, 1.0])
    jets = jet_outlines(np.zeros((6, 2)), np.zeros(6), thrust)
    tall, wide = np.ptp(jets[..., 1], axis=1), np.ptp(jets[..., 0], axis=1)
    assert (tall[:2] == 0).all() and (wide[:2] == 0).all()
    assert tall[2] > 0.015 and (np.diff(tall[2:]) > 0).all()
    # four times the thrust, twice the jet
    (quarter,), (whole,) = jet_size(np.array([0.25])), jet_size(np.array([1.0]))
    assert whole == 1 and quarter == 0.5


def test_units_are_drawn_in_their_true_size_and_turned_with_their_angle():
    boxes = unit_outlines(np.array([[1.0, 2.0], [0.0, 0.0]]), np.array([0.0, np.pi / 2]))
    sizes = boxes.max(axis=1) - boxes.min(axis=1)
    np.testing.assert_allclose(sizes, [[0.04, 0.05], [0.05, 0.04]], atol=1e-9)


def test_units_of_another_size_are_drawn_so_and_stay_so_in_a_file(tmp_path):
    """The area of all units in a picture grows with that of one; a file of before has the usual."""
    slim = replace(swim(4), unit_length=0.02, unit_width=0.025)
    slim.save(tmp_path / "slim.npz")
    slim = Trajectory.load(tmp_path / "slim.npz")
    assert slim.unit_size == (0.02, 0.025)

    def picture(one):
        return next(frames([replace(one, thrust=0 * one.thrust)], Film(640, 360))).astype(int)

    def area(one):
        bare = picture(replace(one, unit_length=0.01, unit_width=0.01))
        return (abs(picture(one) - bare) > 20).any(axis=-1).sum()

    assert area(slim) == pytest.approx(area(swim(4)) / 4, rel=0.4)


@pytest.mark.parametrize("bearing", [0.0, 1.0, 2.5, -2.0])
@pytest.mark.parametrize("box", [Box(10.0, 20.0, 640.0, 360.0), Box(0.0, 0.0, 200.0, 400.0)])
def test_all_that_happens_is_within_the_rectangle(bearing, box):
    one = swim(7, bearing)
    points = Scene(one, box, "").at(np.vstack([one.unit_position.reshape(-1, 2), one.target]))
    assert (points > [box.x, box.y]).all()
    assert (points < [box.x + box.width, box.y + box.height]).all()


@pytest.mark.parametrize("count", range(1, 10))
def test_panels_fill_the_picture_without_overlap(count):
    boxes = layout(count, SMALL)
    assert len(boxes) == count
    covered = np.zeros((180, 320), int)
    for box in boxes:
        rows = slice(round(box.y), round(box.y + box.height))
        covered[rows, round(box.x) : round(box.x + box.width)] += 1
    assert covered.max() == 1 and covered.mean() > 0.8


def test_a_chain_that_never_moved_and_lengths_side_by_side_can_be_drawn(tmp_path):
    still = made(np.zeros((1, 2, 2)), np.zeros((1, 2)), np.zeros((2, 2)), success=False)
    assert write_video([still, swim(3)], tmp_path / "x.gif", SMALL, quiet).stat().st_size > 1000


def test_drawing_needs_no_display_and_no_ffmpeg_of_the_system(tmp_path, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert write_video([swim(2, times=3)], tmp_path / "x.mp4", SMALL, quiet).exists()


@pytest.mark.parametrize(
    ("film", "says"),
    [
        ({"width": 321}, "even number of pixels"), ({"height": 10_000}, "even number"),
        ({"rate": 0.0}, "frame rate"), ({"speed": 0.0}, "speed must be"),
        ({"speed": float("nan")}, "speed must be"),
    ],
)  # fmt: skip
def test_a_film_that_cannot_be_is_refused(film, says):
    with pytest.raises(InputError, match=says):
        Film(**film)


def test_an_unknown_suffix_is_refused_and_a_missing_pyav_named(tmp_path, monkeypatch):
    with pytest.raises(InputError, match=r"\.mp4, \.gif or \.png"):
        write_video([swim(2)], tmp_path / "x.avi", SMALL, quiet)
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(InputError, match=r"\[video\]"):
        check_suffix(tmp_path / "x.mp4")
    with pytest.raises(InputError, match="at least one"):
        write_video([], tmp_path / "x.gif", SMALL, quiet)
    assert list(tmp_path.iterdir()) == [] and set(DEFAULTS) == {".mp4", ".gif", ".png"}


@pytest.mark.parametrize(("given", "bar"), [(0.13, 0.1), (0.2, 0.2), (4.9, 2), (12.0, 10)])
def test_scale_bars_have_round_lengths(given, bar):
    assert round_length(given) == pytest.approx(bar)
