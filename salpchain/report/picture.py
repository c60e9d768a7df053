"""A picture of recorded swims: where chains of several lengths started, swam and ended."""

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

from salpchain import given
from salpchain.evaluation.trajectory import Trajectory, as_swims
from salpchain.files import StrPath, write_bytes
from salpchain.report import surroundings
from salpchain.report.shapes import (
    REACHED,
    Size,
    crosses,
    length_name,
    lines,
    round_length,
    unit_outlines,
)

WIDTH = 10.0  # inches, of the picture
GAP = 0.12  # inches, between panels
HEADER, FOOTER = 0.5, 0.2  # inches, above and below the swim in each panel
WATER, INK, FAINT = "#0d2438", "#f2f6fa", "#8fa9bf"
PLACES = ListedColormap(mpl.colormaps["viridis"](np.linspace(0.34, 1.0, 256)))
STREAKS = 20  # of moving water along a panel's longer side (chosen)
POSES = 5  # shown between the first and the last (chosen)
SHAPES = (0.62, 2.6)  # lowest and highest width of a swim for its height

Points = Float[np.ndarray, "point 2"]


@dataclass(frozen=True)
class View:
    """A swim turned so that it leads to the right, and the rectangle (m) that holds it."""

    swim: Trajectory
    turn: Float[np.ndarray, "2 2"]
    low: Float[np.ndarray, "2"]
    size: Float[np.ndarray, "2"]

    @property
    def shape(self) -> float:
        """Width for a height of one."""
        return float(self.size[0] / self.size[1])


def chains_picture(
    swims: Trajectory | Sequence[Trajectory], out: StrPath, rows: int | None = None
) -> Path:
    """The swims as one PNG picture, each turned so that it leads to the right; returns its path.

    In each panel: the start pose in outline, the ways of the units, poses in between, the final
    pose coloured by place in the chain, on the target pose as a band as wide as the goal allows;
    length, time and closed fraction; a scale bar. Units are drawn in their true size.

    Raises:
        InputError: no swims.
    """
    swims, out = as_swims(swims), given.path("out", out)
    if rows is not None:
        given.whole("rows", rows, least=1)
    lines = _lines([_view(swim) for swim in swims], rows or (len(swims) + 2) // 3)
    heights = [_height(line) for line in lines]
    total = sum(heights) + GAP * (len(lines) + 1) + (HEADER + FOOTER) * len(lines)
    figure = Figure(figsize=(WIDTH, total), dpi=200, facecolor="none")
    top = total - GAP
    for line, height in zip(lines, heights, strict=True):
        left, panel_height = GAP, height + HEADER + FOOTER
        for view in line:
            width = height * view.shape
            place = (left, top - panel_height, width, panel_height)
            _draw(_panel(figure, place, total), view, view.size[1] / height, place)
            left += width + GAP
        top -= panel_height + GAP
    out.parent.mkdir(parents=True, exist_ok=True)
    content = io.BytesIO()
    figure.savefig(content, format="png")
    write_bytes(out.with_suffix(".png"), content.getvalue())
    return out.with_suffix(".png")


def _view(swim: Trajectory) -> View:
    """The swim turned by the bearing of its target, in a rectangle of moderate shape."""
    away = swim.targets[0].mean(axis=0) - swim.unit_position[0].mean(axis=0)
    cos, sin = away / max(np.linalg.norm(away), 1e-9)
    turn = np.array([[cos, sin], [-sin, cos]])
    points = np.concatenate([swim.unit_position, swim.targets]).reshape(-1, 2)
    points = np.concatenate([points, surroundings.near(swim.around, points)]) @ turn.T
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.06 * swim.scale + 0.03 * (high - low).max()
    size = high - low + 2 * margin
    wanted = np.clip(size[0] / size[1], *SHAPES)
    grown = np.maximum(size, [size[1] * wanted, size[0] / wanted])
    return View(swim, turn, low - margin - (grown - size) / 2, grown)


def _lines(views: list[View], rows: int) -> list[list[View]]:
    """The views in so many lines of much the same width, in their order."""
    widths = np.array([view.shape for view in views])
    middle = np.cumsum(widths) - widths / 2
    line = np.floor(rows * middle / widths.sum()).astype(int)
    split = [[v for v, at in zip(views, line, strict=True) if at == row] for row in range(rows)]
    return [members for members in split if members]


def _height(line: list[View]) -> float:
    """Height (inches) at which the swims of a line fill the width."""
    return (WIDTH - GAP * (len(line) + 1)) / sum(view.shape for view in line)


def _panel(figure: Figure, place: tuple[float, float, float, float], total: float) -> Axes:
    left, bottom, width, height = place
    panel = figure.add_axes((left / WIDTH, bottom / total, width / WIDTH, height / total))
    panel.set_axis_off()
    corner = FancyBboxPatch(
        (0, 0), 1, 1, boxstyle="round,pad=0,rounding_size=0.02", transform=panel.transAxes,
        mutation_aspect=width / height, facecolor=WATER, edgecolor="none", zorder=0, clip_on=False,
    )  # fmt: skip
    panel.add_patch(corner)
    return panel


def _draw(panel: Axes, view: View, scale: float, place: tuple[float, float, float, float]) -> None:
    """One swim; `scale` is metres for each inch."""
    (x, y), (width, height) = view.low, view.size
    panel.set_xlim(x, x + width)
    panel.set_ylim(y - FOOTER * scale, y + height + HEADER * scale)
    point = scale / 72
    swim, turned = view.swim, view.swim.unit_position @ view.turn.T
    angle = np.arctan2(view.turn[1, 0], view.turn[0, 0])
    _draw_water(panel, view)
    _draw_obstacles(panel, view, point)
    own = point / swim.scale  # metres of a chain with the paper's links for each point
    _draw_target(panel, swim.targets[-1] @ view.turn.T, own)
    if swim.target_moves:
        way = swim.targets.mean(axis=1) @ view.turn.T
        panel.plot(*way.T, color="#7fb2d6", linewidth=1.0, alpha=0.7, zorder=1.2)
    _draw_ways(panel, turned)
    size = swim.unit_size
    for time, strength in _moments(turned):
        dead = swim.around.dead(time, swim.length) & (strength == 1)
        _draw_links(panel, [part @ view.turn.T for part in lines(swim, time)], strength, own)
        _draw_chain(panel, turned[time], swim.unit_angle[time] + angle, strength, own, size)
        _draw_dead(panel, turned[time][dead], swim.unit_angle[time][dead] + angle, own, size)
    _draw_words(panel, view, place, point)


def _moments(positions: Float[np.ndarray, "time unit 2"]) -> list[tuple[int, float]]:
    """Times at which the chain has gone equal parts of its way, and how strongly to draw them."""
    moved = np.linalg.norm(np.diff(positions, axis=0), axis=-1).mean(axis=1)
    way = np.concatenate([[0.0], np.cumsum(moved)])
    parts = np.linspace(0, 1, POSES + 2)
    times = [int(np.argmax(way >= part * way[-1])) for part in parts]
    between = [(t, 0.25 + 0.35 * part) for t, part in zip(times[1:-1], parts[1:-1], strict=True)]
    return [(0, 0.0), *between, (len(positions) - 1, 1.0)]


def _draw_water(panel: Axes, view: View) -> None:
    """Streaks along which the water moves when half of the swim is over, brighter ahead."""
    swim = view.swim
    if not surroundings.is_moving(swim.around):
        return
    apart = view.size.max() / STREAKS
    across, up = (np.arange(low, low + size + apart, apart) for low, size in _shown(view))
    start = np.stack(np.meshgrid(across, up), axis=-1).reshape(-1, 2) @ view.turn
    time = max(swim.duration / 2, 4 * surroundings.LIFE)
    ways = surroundings.streaks(swim.around, start, time, 2 * time) @ view.turn.T
    for piece in range(surroundings.PIECES):
        alpha = 0.08 + 0.4 * (piece + 1) / surroundings.PIECES
        lines = LineCollection(
            list(ways[:, piece : piece + 2]),
            colors="#7fb2d6",
            linewidths=0.6,
            alpha=alpha,
            zorder=1,
        )
        panel.add_collection(lines)


def _shown(view: View) -> list[tuple[float, float]]:
    """Where the swim begins and how large it is (m), in either direction."""
    return [(float(low), float(size)) for low, size in zip(view.low, view.size, strict=True)]


def _draw_obstacles(panel: Axes, view: View, point: float) -> None:
    """Walls and posts: the rims first, so that where two meet there is none."""
    around = view.swim.around
    shapes = surroundings.wall_outlines(around.walls), surroundings.post_outlines(around.posts)
    outlines = [outline @ view.turn.T for every in shapes for outline in every]
    rim = {"edgecolors": "#94abb8", "linewidths": max(0.01 / point, 1.0)}
    panel.add_collection(PolyCollection(outlines, facecolors="none", zorder=1.1, **rim))
    panel.add_collection(PolyCollection(outlines, facecolors="#334554", zorder=1.2))


def _draw_dead(
    panel: Axes, position: Points, angle: Float[np.ndarray, " unit"], point: float, size: Size
) -> None:
    """Units whose thruster is dead: grey, with a cross."""
    if not len(position):
        return
    boxes, width = unit_outlines(position, angle, size), max(0.006 / point, 0.5)
    panel.add_collection(PolyCollection(list(boxes), facecolors="#334554", alpha=0.8, zorder=4.1))
    marks = crosses(position, angle, size)
    panel.add_collection(LineCollection(list(marks), colors=INK, linewidths=width, zorder=4.2))


def _draw_target(panel: Axes, target: Points, point: float) -> None:
    """The target pose as a band within which the goal is reached, with its points."""
    wide = 2 * REACHED / point
    for width, colour in ((wide, "#5f8fb0"), (max(wide - 1.6, 0), "#1c3d57")):
        panel.plot(*target.T, color=colour, linewidth=width, zorder=1, **_ROUND)
    panel.scatter(*target.T, s=(0.016 / point) ** 2, color="#7fb2d6", linewidths=0, zorder=1.5)


_ROUND: dict[str, Any] = {"solid_capstyle": "round", "solid_joinstyle": "round"}


def _draw_ways(panel: Axes, positions: Float[np.ndarray, "time unit 2"]) -> None:
    """The way of each unit, brighter towards its end."""
    stride = max(1, len(positions) // 250)
    ways = np.concatenate([positions[:-1:stride], positions[-1:]])
    age = np.linspace(0.15, 0.55, len(ways) - 1)
    for unit, colour in enumerate(_colours(positions.shape[1])):
        pieces = np.stack([ways[:-1, unit], ways[1:, unit]], axis=1)
        shades = np.column_stack([np.tile(colour[:3], (len(age), 1)), age])
        width = min(0.8, 8 / positions.shape[1] + 0.25)
        panel.add_collection(
            LineCollection(list(pieces), colors=shades, linewidths=width, zorder=2)
        )


def _draw_links(panel: Axes, parts: list[Points], strength: float, point: float) -> None:
    width, alpha = max(0.012 / point, 0.5), 0.8 * max(strength, 0.35)
    for part in parts:
        panel.plot(*part.T, color=INK, alpha=alpha, linewidth=width, zorder=3, **_ROUND)


def _draw_chain(
    panel: Axes,
    position: Points,
    angle: Float[np.ndarray, " unit"],
    strength: float,
    point: float,
    size: Size,
) -> None:
    """Units; in outline at strength 0, the start."""
    colours = _colours(len(position))
    boxes = unit_outlines(position, angle, size)
    if strength == 0:
        edge = {"facecolors": WATER, "edgecolors": FAINT, "linewidths": max(0.004 / point, 0.3)}
    elif strength < 1:
        edge = {"facecolors": colours * [1, 1, 1, strength], "edgecolors": "none"}
    else:
        edge = {"facecolors": colours, "edgecolors": WATER, "linewidths": 0.004 / point}
    panel.add_collection(PolyCollection(list(boxes), zorder=3 + strength, **edge))


def _colours(count: int) -> Float[np.ndarray, "unit 4"]:
    return np.asarray(PLACES(np.linspace(0, 1, count)))


def _draw_words(
    panel: Axes, view: View, place: tuple[float, float, float, float], point: float
) -> None:
    """Length, clock and closed fraction above the swim, and a scale bar in a corner."""
    swim, (_, _, width, height) = view.swim, place
    time = f"{swim.duration:.0f} s"
    clock = f"goal in {time}" if swim.success else f"after {time}"
    words = f"{clock}, {100 * swim.closed_fraction:.1f} % closed"
    left, text = 0.16 / width, {"transform": panel.transAxes, "va": "center", "zorder": 9}
    title = f"{swim.length} units" + "".join(f", {name}" for name in swim.unusual)
    panel.text(left, 1 - 0.22 / height, title, color=INK, size=11, weight="bold", **text)
    panel.text(left, 1 - 0.42 / height, words, color=FAINT, size=8, **text)
    bar = round_length(view.size[0] / 5)
    right, low = view.low[0] + view.size[0] - 11 * point, view.low[1] - 4 * point
    panel.plot([right - bar, right], [low, low], color=INK, linewidth=1.4, zorder=9)
    name = length_name(bar)
    panel.text(
        right - bar - 4 * point, low, name, color=INK, size=7.5, ha="right", va="center", zorder=9
    )
