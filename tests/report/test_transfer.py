"""The zero-shot figure, asked of Matplotlib: what its axes, texts and lines are."""

import itertools
import json

import numpy as np
import pytest
from matplotlib import rc_context

from salpchain.report.style import STYLE
from salpchain.report.transfer import CLOSE, transfer_figure
from tests.report.test_figures import make_evaluation

TESTED = {
    "the paper's": tuple(range(4, 65, 4)),
    "the demo's": (4, 8, 16, 24, 32, 40, 48, 56, 64),
    "few": (2, 3, 4, 5),
    "all": tuple(range(2, 129)),
    "uneven": (2, 3, 8, 128),
    "one": (24,),
}


def drawn(tmp_path, lengths, names=("swimmer",), **changed):
    """The figure of evaluations of these lengths, laid out as it would be saved."""
    summaries = []
    for name in names:
        path = make_evaluation(tmp_path / "x.json", name, lengths=lengths)
        summaries.append(json.loads(path.read_text()))
    for summary in summaries:
        for entry in summary["lengths"]:
            entry.update(changed)
    with rc_context(STYLE):
        figure = transfer_figure(summaries, list(names))
        figure.draw_without_rendering()
    return figure


def value(mean):
    return {"mean": mean, "low": mean - 0.02, "high": mean + 0.02}


def texts_of(figure):
    """All texts that are seen, with their boxes."""
    found = [*figure.texts, *figure.legends[0].get_texts()]
    if figure._supylabel:
        found.append(figure._supylabel)
    for panel in figure.axes:
        found += [
            panel.title,
            panel._right_title,
            panel.xaxis.label,
            panel.yaxis.label,
            *panel.texts,
        ]
        for axis in (panel.xaxis, panel.yaxis):
            low, high = axis.get_view_interval()
            for tick in axis.get_major_ticks():
                if low - 1e-9 <= tick.get_loc() <= high + 1e-9 and tick.label1.get_visible():
                    found.append(tick.label1)
    seen = {id(text): text for text in found if text.get_text()}.values()
    return [(text.get_text(), text.get_window_extent()) for text in seen]


@pytest.mark.parametrize("lengths", TESTED.values(), ids=TESTED)
@pytest.mark.parametrize("names", [("swimmer",), ("a", "b", "c", "a-much-longer-name-than-these")])
def test_no_two_texts_overlap_and_all_are_on_the_page(tmp_path, lengths, names):
    figure = drawn(tmp_path, lengths, names)
    texts = texts_of(figure)
    assert len(texts) > 15
    boxes = np.array([box.extents for _, box in texts])
    low, high = boxes[:, None, :2], boxes[:, None, 2:]
    overlap = ((low <= boxes[:, 2:]) & (boxes[:, :2] <= high)).all(-1)
    assert [(texts[i][0], texts[j][0]) for i, j in np.argwhere(np.triu(overlap, 1))] == []
    for text, box in texts:
        assert box.x0 >= -1 and box.x1 <= figure.bbox.width + 1, text
        assert box.y0 >= -1 and box.y1 <= figure.bbox.height + 1, text


@pytest.mark.parametrize("lengths", TESTED.values(), ids=TESTED)
def test_the_axis_has_whole_numbers_of_units(tmp_path, lengths):
    for panel in drawn(tmp_path, lengths).axes[-2:]:
        low, high = panel.get_xlim()
        shown = [x for x in panel.xaxis.get_majorticklocs() if low <= x <= high]
        assert shown and np.allclose(shown, np.round(shown))
        labels = [panel.xaxis.get_major_formatter()(x) for x in shown]
        assert [int(label) for label in labels] == [round(x) for x in shown]
        assert low < min(lengths) and high > max(lengths)


def test_few_lengths_have_a_tick_each(tmp_path):
    for name in ("the paper's", "the demo's", "few", "one"):
        panel = drawn(tmp_path, TESTED[name]).axes[-1]
        assert panel.xaxis.get_majorticklocs().tolist() == list(TESTED[name])


def test_one_length_is_drawn_as_bars_with_their_numbers_and_as_points(tmp_path):
    figure = drawn(
        tmp_path, (24,), ("one", "other"), success=value(0.93), closed_fraction=value(0.98)
    )
    upper, lower = figure.axes[:2], figure.axes[2:]
    for panel, mean in zip(lower, (0.98, 0.93), strict=True):
        bars = [c for c in panel.containers if hasattr(c, "patches")]
        heights = [bar.get_height() for c in bars for bar in c.patches]
        assert heights[:2] == [mean, mean] and len(heights) == 3  # and greedy's
        assert [t.get_text() for t in panel.texts][:2] == [f"{100 * mean:.0f} %"] * 2
        places = [(bar.get_x(), bar.get_x() + bar.get_width()) for c in bars for bar in c.patches]
        assert all(a[1] <= b[0] for a, b in itertools.pairwise(places))
    assert all(not p.patches or p in lower for p in figure.axes)
    assert all(np.isfinite(line.get_ydata()).all() for line in upper[0].get_lines())


@pytest.mark.parametrize("mean", [0.3, 0.97])
def test_bars_are_named_with_and_without_enlarged_panels(tmp_path, mean):
    both = {"success": value(mean), "closed_fraction": value(mean)}
    figure = drawn(tmp_path, (24,), ("one", "other"), **both)
    named = [text.get_text() for text in figure.legends[0].get_texts()]
    assert {"one", "other"} <= set(named) and len(named) == len(set(named))


@pytest.mark.parametrize("lengths", [(24,), (4, 8, 16)])
def test_the_physical_limit_is_named_and_lies_above_all_else(tmp_path, lengths):
    figure = drawn(tmp_path, lengths, closed_fraction=value(0.99), reachable=value(0.97))
    for panel in (figure.axes[0], figure.axes[2]):
        [limit] = [x for x in panel.get_lines() if x.get_label() == "physical limit"]
        others = [x for x in panel.get_children() if x is not limit and x not in panel.texts]
        assert all(x.get_zorder() < limit.get_zorder() for x in others if x.get_visible())
        assert set(np.asarray(limit.get_ydata())) == {0.97}
        seen = np.asarray(limit.get_xdata())
        low, high = panel.get_xlim()
        assert np.ptp(np.clip(seen, low, high)) > 0.5 * (high - low)
    assert "physical limit" in [text.get_text() for text in figure.legends[0].get_texts()]


def test_what_is_close_to_the_top_is_enlarged(tmp_path):
    figure = drawn(tmp_path, (4, 8), closed_fraction=value(0.99), success=value(0.5))
    assert len(figure.axes) == 4
    for panel in figure.axes[:2]:
        assert panel.get_ylim()[0] == CLOSE[0] and 1.0 < panel.get_ylim()[1] < 1.01
    notes = [panel.get_title(loc="right") for panel in figure.axes[:2]]
    assert notes == ["90 to 100 %, enlarged", "no mean is 90 % or more"]
    for panel in figure.axes[2:]:
        assert panel.get_ylim()[0] <= 0.0 and panel.get_ylim()[1] >= 1.0


def test_where_nothing_is_close_to_the_top_nothing_is_enlarged(tmp_path):
    figure = drawn(tmp_path, (4, 8), closed_fraction=value(0.6), success=value(0.5))
    assert len(figure.axes) == 2


@pytest.mark.parametrize("low", [0.0, 0.02])
def test_the_number_of_a_low_bar_stands_on_it_beside_its_interval(tmp_path, low):
    mean = {"mean": low, "low": 0.0, "high": 0.4}
    figure = drawn(tmp_path, (24,), ("one", "other"), success=mean)
    panel = figure.axes[-1]
    bars = [bar for c in panel.containers if hasattr(c, "patches") for bar in c.patches]
    for bar, text in list(zip(bars, panel.texts, strict=True))[:2]:
        assert text.get_text() == f"{100 * low:.0f} %"
        box, top = text.get_window_extent(), bar.get_window_extent().y1
        assert 0 < box.y0 - top < box.height
        middle = (bar.get_window_extent().x0 + bar.get_window_extent().x1) / 2
        assert box.x0 > middle  # where the interval's line is


def test_a_number_in_a_bar_is_not_crossed_by_its_interval(tmp_path):
    for low, inside in ((0.05, False), (0.3, True)):
        mean = {"mean": 0.5, "low": low, "high": 0.9}
        text = drawn(tmp_path, (24,), success=mean).axes[-1].texts[0]
        assert (text.xy[1] == 0) == inside == (text.get_ha() == "center")


@pytest.mark.parametrize(("lengths", "named"), [((4, 16), True), ((16, 64), False)])
def test_a_training_length_outside_the_figure_is_not_in_the_legend(tmp_path, lengths, named):
    figure = drawn(tmp_path, lengths)
    told = [text.get_text() for text in figure.legends[0].get_texts()]
    assert ("trained on 8 units" in told) == named


def test_the_world_and_the_task_are_named_where_they_differ_or_are_unusual(tmp_path):
    def words(*settings):
        path = make_evaluation(tmp_path / "x.json", "swimmer", lengths=(4, 8))
        summaries = [{**json.loads(path.read_text()), **each} for each in settings]
        figure = transfer_figure(summaries, ["swimmer"] * len(summaries))
        title = figure.get_suptitle()
        return title, [text.get_text() for text in figure.legends[0].get_texts()]

    title, lines = words({})
    assert title == "" and "swimmer" in lines
    title, lines = words({"world": "rough", "task": "follow"})
    assert title == "task follow, world rough" and "swimmer" in lines
    title, lines = words({"world": "rough"}, {"world": "still"})
    assert title == ""
    assert {"swimmer, world rough", "swimmer, world still"} < set(lines)
    assert {"physical limit, world rough", "physical limit, world still"} < set(lines)


def test_where_the_target_moves_no_limit_is_drawn(tmp_path):
    unknown = {"mean": None, "low": None, "high": None}
    figure = drawn(tmp_path, (4, 8), reachable=unknown)
    assert not any("limit" in text.get_text() for text in figure.legends[0].get_texts())
