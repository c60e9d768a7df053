"""The zero-shot figure: closed fraction and success against length, whole and from 90 to 100 %."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator, NullLocator

from salpchain.report.style import GREY, legend_below, looks, percent_axes

MEASURES = ("closed_fraction", "success")
LIMIT_NAMES = {"fixed": "512 steps", "scaled": "scaled time"}
LIMIT_COLOUR, BEYOND, BAND = "#222222", "#e4e4e4", "#eef4f9"
DASHES = ("-", "--", ":", "-.")
USUAL = ("world still", "task reach")
CLOSE = (0.9, 1.0)  # what the upper panels show
TICKS = 17  # numbers of units that fit below a panel (chosen)
BAR = 0.16  # width of a bar, where one length was tested and is one unit wide (chosen)


def _setting(summary: dict[str, Any]) -> tuple[str, str, str]:
    """The time limit, the world and the task in words; older files know one world and task."""
    world, task = summary.get("world", "still"), summary.get("task", "reach")
    return LIMIT_NAMES[summary["time_limit"]], f"world {world}", f"task {task}"


@dataclass(frozen=True)
class Series:
    """One line of the figure, or one bar of each panel."""

    name: str
    look: Any  # colour, marker, dashes
    entries: Sequence[dict[str, Any]]  # of evaluation.json, one for each length
    shift: float  # by which it is moved aside (units), so that intervals do not hide one another

    def values(self, measure: str) -> np.ndarray:
        """Length, mean, low and high, (4, length); no interval is one of no width."""
        rows = []
        for entry in self.entries:
            mean, low, high = (entry[measure][side] for side in ("mean", "low", "high"))
            rows.append([entry["length"], mean, *(mean if x is None else x for x in (low, high))])
        return np.array(rows, float).T


@dataclass(frozen=True)
class Contents:
    """What the figure shows."""

    summaries: Sequence[dict[str, Any]]  # evaluation.json
    names: Sequence[str]  # of their policies

    @cached_property
    def lengths(self) -> list[int]:
        """All lengths that were tested, ascending."""
        return sorted({entry["length"] for s in self.summaries for entry in s["lengths"]})

    @property
    def single(self) -> bool:
        """Whether only one length was tested, which makes bars instead of lines."""
        return len(self.lengths) == 1

    @cached_property
    def one_for_each_setting(self) -> list[dict[str, Any]]:
        """For each time limit, world and task the evaluation of most lengths."""
        ordered = sorted(self.summaries, key=lambda s: len(s["lengths"]))
        return list({_setting(s): s for s in ordered}.values())

    def setting_name(self, summary: dict[str, Any]) -> str:
        """The time limit, the world and the task, each where there are several."""
        settings = zip(*map(_setting, self.summaries), strict=True)
        parts = zip(_setting(summary), settings, strict=True)
        return "".join(f", {part}" for part, all_of_it in parts if len(set(all_of_it)) > 1)

    @property
    def place(self) -> str:
        """The world and the task of all, where they are others than the paper's."""
        _, worlds, tasks = map(set, zip(*map(_setting, self.summaries), strict=True))
        alike = [next(iter(kind)) for kind in (tasks, worlds) if len(kind) == 1]
        return ", ".join(part for part in alike if part not in USUAL)

    @cached_property
    def series(self) -> list[Series]:
        """The policies, then the greedy baseline once for each time limit."""
        known: list[tuple[str, Any, Any]] = [
            (name + self.setting_name(summary), look, summary["lengths"])
            for look, name, summary in zip(looks(), self.names, self.summaries, strict=False)
        ]
        baseline = "greedy (baseline)" if "greedy" in self.names else "greedy"
        known += [
            (
                f"{baseline}{self.setting_name(summary)}",
                (GREY, "p", dashes),
                summary["baseline"]["lengths"],
            )
            for dashes, summary in zip(cycle(DASHES), self.one_for_each_setting, strict=False)
            if summary.get("baseline")
        ]
        span = max(self.lengths) - min(self.lengths)
        apart = BAR if self.single else min(0.006 * span, 0.35)
        middle = (len(known) - 1) / 2
        return [
            Series(name, look, entries, apart * (place - middle))
            for place, (name, look, entries) in enumerate(known)
        ]

    @property
    def trained(self) -> list[int]:
        """Lengths that the policies were trained on, as far as the figure reaches."""
        cards = [s["card"] for s in self.summaries if s.get("card", {}).get("steps")]
        low, high = self.reach
        return sorted({card["length"] for card in cards if low <= card["length"] <= high})

    @property
    def size(self) -> float:
        """Of the numbers of bars (points), which must not reach into the next bar."""
        return 9.0 if len(self.series) <= 4 else max(8.0 - len(self.series) / 4, 5.0)

    @property
    def reach(self) -> tuple[float, float]:
        """From where to where the axis of lengths goes."""
        first, last = self.lengths[0], self.lengths[-1]
        pad = max(0.03 * (last - first), 0.25)
        if self.single:
            pad = BAR * (len(self.series) + 2) / 2
        return first - pad, last + pad

    def is_close(self, measure: str) -> bool:
        """Whether any mean is in the range that the upper panels show."""
        return any((one.values(measure)[1] >= CLOSE[0]).any() for one in self.series)


def transfer_figure(summaries: Sequence[dict[str, Any]], names: Sequence[str]) -> Figure:
    """Closed fraction and success, the mean over trials with its 95 % interval, by length.

    `summaries` are contents of evaluation.json, `names` those of their policies. Below, from 0 to
    100 %; above, what is at 90 % or more, where anything is. Of one tested length, bars below and
    points above. The physical limit is drawn over everything else.
    """
    contents = Contents(summaries, names)
    close = any(map(contents.is_close, MEASURES))
    figure = Figure(figsize=(9, 5.6 if close else 4.2), layout="constrained")
    heights = [1.0, 1.5] if close else [1.0]
    grid = figure.subplots(
        len(heights), 2, sharex=True, sharey="row", squeeze=False, height_ratios=heights
    )
    for column, measure in enumerate(MEASURES):
        grid[0, column].set_title(measure.replace("_", " "))
        for panel in grid[:, column]:
            _draw(panel, contents, measure, bars=contents.single and panel is grid[-1, column])
        _label_lengths(grid[-1, column], contents)
        if close:
            _close_up(grid[0, column], contents.is_close(measure))
            grid[-1, column].axhspan(*CLOSE, color=BAND, zorder=-1)
    percent_axes(grid[-1], "")
    figure.supylabel("mean over trials, 95 % interval", fontsize=11)
    if contents.place:
        figure.suptitle(contents.place, fontsize=11)
    legend_below(figure, grid.ravel())
    return figure


def _draw(panel: Axes, contents: Contents, measure: str, bars: bool) -> None:
    """All series of a measure, what they are seen against, and the limit above them."""
    for one in contents.series:
        if bars:
            _draw_bar(panel, one, measure, contents.size)
        else:
            _draw_line(panel, one, measure)
    if not contents.single and contents.trained:
        *more, last = map(str, contents.trained)
        known = f"{', '.join(more)} and {last}" if more else last
        for length in contents.trained:
            panel.axvline(
                length, color=GREY, linewidth=0.8, linestyle=(0, (4, 3)), zorder=0,
                label=f"trained on {known} units",
            )  # fmt: skip
    if measure == "closed_fraction":
        for dashes, summary in zip(cycle(DASHES), contents.one_for_each_setting, strict=False):
            name = f"physical limit{contents.setting_name(summary)}"
            _draw_limit(panel, contents, summary["lengths"], dashes, name)


def _draw_line(panel: Axes, one: Series, measure: str) -> None:
    """Means and intervals; of one length a point."""
    colour, marker, dashes = one.look
    lengths, mean, low, high = one.values(measure)
    panel.errorbar(
        lengths + one.shift, mean, (mean - low, high - mean), color=colour, marker=marker,
        linestyle=dashes, elinewidth=1.0, label=one.name, zorder=2 if colour == GREY else 3,
    )  # fmt: skip


def _draw_bar(panel: Axes, one: Series, measure: str, size: float) -> None:
    """A bar with its interval, and the mean in words at its foot or, where it is low, on its top.

    On its top the words stand beside the line of the interval.
    """
    lengths, mean, low, high = one.values(measure)
    at = lengths + one.shift
    panel.bar(
        at, mean, width=0.8 * BAR, color=one.look[0], alpha=0.75, zorder=2, label=one.name
    )  # fmt: skip
    panel.errorbar(at, mean, (mean - low, high - mean), color="black", fmt="none", zorder=3)
    for x, value, least in zip(at, mean, low, strict=True):
        words = f"{100 * value:.0f} %" if value < 0.995 or value == 1 else f"{100 * value:.1f} %"
        inside = least > 0.15
        place = {"ha": "center", "xytext": (0, 4)} if inside else {"ha": "left", "xytext": (2, 4)}
        panel.annotate(
            words,
            (x, 0.0 if inside else max(value, 0.0)),
            textcoords="offset points",
            **place,
            fontsize=size,
            weight="bold",
            color="white" if inside else "black",
            zorder=6,
        )


def _draw_limit(
    panel: Axes, contents: Contents, entries: Sequence[dict[str, Any]], dashes: str, name: str
) -> None:
    """What no controller can pass, above all series; across the panel for one length."""
    lengths = np.array([entry["length"] for entry in entries], float)
    limit = np.array([entry["reachable"]["mean"] for entry in entries], float)
    if np.isnan(limit).all():  # a target that moves: what is possible is not known
        return
    if contents.single:
        lengths, limit = lengths[0] + np.array([-9.0, 9.0]), np.repeat(limit, 2)
    if len(contents.one_for_each_setting) == 1:
        panel.fill_between(lengths, limit, 1.2, color=BEYOND, linewidth=0, zorder=0)
    panel.plot(
        lengths, limit, color=LIMIT_COLOUR, linewidth=1.3, linestyle=dashes, label=name, zorder=5
    )


def _label_lengths(panel: Axes, contents: Contents) -> None:
    """Whole numbers of units: the tested ones where they fit."""
    lengths = contents.lengths
    panel.set_xlabel("length (units)")
    panel.xaxis.set_minor_locator(NullLocator())
    panel.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.0f}"))
    panel.set_xlim(*contents.reach)
    if _fit(lengths):
        panel.xaxis.set_major_locator(FixedLocator(lengths))
    else:
        panel.xaxis.set_major_locator(MaxNLocator(9, integer=True, steps=[1, 2, 4, 8, 10]))


def _fit(lengths: list[int]) -> bool:
    """Whether the numbers have room beside one another."""
    gaps: Iterable[int] = np.diff(lengths)
    return all(gap * TICKS >= lengths[-1] - lengths[0] for gap in gaps)


def _close_up(panel: Axes, shown: bool) -> None:
    """The panel from 90 to 100 %."""
    low, high = CLOSE
    panel.set_ylim(low, high + 0.006)
    panel.set_facecolor(BAND)
    panel.yaxis.set_major_locator(FixedLocator(np.linspace(low, high, 6).tolist()))
    panel.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{100 * value:.0f} %"))
    panel.grid(axis="y", color="white", linewidth=0.9)
    words = "90 to 100 %, enlarged" if shown else "no mean is 90 % or more"
    panel.set_title(words, loc="right", fontsize=8, color=GREY)
