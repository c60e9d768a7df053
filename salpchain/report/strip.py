"""A strip: a row for each swim, a column for each moment, with a time axis below each row."""

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from salpchain.errors import InputError
from salpchain.evaluation.trajectory import Trajectory
from salpchain.report.canvas import Canvas, shortened, text_width
from salpchain.report.scene import DEEP, DONE, FAINT, INK, Box, Scene, water

MOMENTS = 6  # columns (chosen)
MOST = 60_000_000  # pixels of a strip (chosen)
GAP = 6.0  # pixels between the moments of a row
PAGE = tuple(0.5 * DEEP)
HEADER, CAPTION, AXIS = 4.4, 2.2, 4.6  # heights for a text size of one
ONE = "From start to end, at equal steps of time."
EACH = "Each row is one swim from start to end, at equal steps of its own time."
BELOW = "Below each moment: time and mean distance to the target."


@dataclass(frozen=True)
class Layout:
    """Where things are on the strip (pixels from its lower left corner)."""

    rows: int
    width: int  # of a moment
    height: int

    @property
    def text_size(self) -> float:
        """Of all words but the header's title (pixels)."""
        return max(9.0, self.width / 16)

    @property
    def margin(self) -> float:
        """Between the picture's edge and what it shows."""
        return 0.8 * self.text_size

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the whole strip."""
        across = MOMENTS * self.width + (MOMENTS - 1) * GAP + 2 * self.margin
        return int(np.ceil(across)), int(np.ceil(HEADER * self.text_size + self.rows * self._row))

    @property
    def _row(self) -> float:
        caption = CAPTION if self.rows > 1 else 0.0
        return self.height + (caption + AXIS) * self.text_size

    def panels(self, row: int) -> list[Box]:
        """The rectangles of a row's moments, in time."""
        low = (self.rows - 1 - row) * self._row + AXIS * self.text_size
        left = [self.margin + k * (self.width + GAP) for k in range(MOMENTS)]
        return [Box(x, low, float(self.width), float(self.height)) for x in left]


def strip(swims: Sequence[Trajectory], width: int, height: int) -> bytes:
    """The strip as a PNG picture; width and height (pixels) are those of each moment.

    Raises:
        InputError: the strip would have too many pixels.
    """
    content = io.BytesIO()
    figure = drawn(swims, width, height)
    figure.savefig(content, format="png", dpi=72, pil_kwargs={"optimize": True})
    return content.getvalue()


def drawn(swims: Sequence[Trajectory], width: int, height: int) -> Figure:
    """The strip as a figure of 72 dots for each inch, so that points are pixels."""
    layout = Layout(len(swims), width, height)
    across, high = layout.size
    if across * high > MOST:
        raise InputError(
            f"a strip of {len(swims)} swims with moments of {width}x{height} pixels would have"
            f" {across}x{high}, more than {MOST // 10**6} million: give a smaller size"
        )
    figure = Figure(figsize=(across / 72, high / 72), dpi=72)
    FigureCanvasAgg(figure)
    figure.figimage(_moments(swims, layout), 0, 0, origin="upper")
    _draw_header(figure, swims, layout)
    for row, swim in enumerate(swims):
        if len(swims) > 1:
            _draw_caption(figure, swim, _difference(swims, row), layout, row)
        _draw_axis(figure, swim, layout.panels(row), layout.text_size)
    return figure


def _times(swim: Trajectory) -> list[float]:
    """Control steps nearest to equal parts of the swim (s), the first and the last with it."""
    return [round(part * swim.steps) * swim.dt for part in np.linspace(0, 1, MOMENTS)]


def _moments(swims: Sequence[Trajectory], layout: Layout) -> np.ndarray:
    """The pixels of all moments."""
    canvas = Canvas(*layout.size)
    rows = [layout.panels(row) for row in range(len(swims))]
    water(canvas, [box for boxes in rows for box in boxes], dither=False)
    for swim, boxes in zip(swims, rows, strict=True):
        for box, time in zip(boxes, _times(swim), strict=True):
            scene = Scene(swim, box, "")
            scene.draw_still(canvas)
            scene.draw(canvas, time)
            if box is boxes[0]:  # all moments of a row have one scale
                scene.draw_scale_bar(canvas, 0.75 * layout.text_size)
    return canvas.copy()


def _parts(swim: Trajectory) -> dict[str, str]:
    """What tells a swim from others, by kind."""
    return {
        "policy": swim.policy,
        "length": f"{swim.length} units",
        "world": f"world {swim.world}",
        "task": f"task {swim.task}",
        "seed": f"seed {swim.seed}",
        "trial": f"trial {swim.trial}",
    }


def _shared(swims: Sequence[Trajectory]) -> set[str]:
    """The kinds in which all swims agree."""
    known = [_parts(swim) for swim in swims]
    return {kind for kind in known[0] if len({parts[kind] for parts in known}) == 1}


def _difference(swims: Sequence[Trajectory], row: int) -> str:
    """What tells this swim from the others."""
    shared = _shared(swims)
    parts = [words for kind, words in _parts(swims[row]).items() if kind not in shared]
    return ", ".join(parts) or f"swim {row + 1}"


def _draw_header(figure: Figure, swims: Sequence[Trajectory], layout: Layout) -> None:
    """What all swims share, and how to read the strip; of one swim also how it ended."""
    (across, high), size, margin = layout.size, layout.text_size, layout.margin
    shared = _shared(swims)
    known = _parts(swims[0])
    unusual = [kind for kind in ("task", "world") if getattr(swims[0], kind) in swims[0].unusual]
    kinds = ["policy", "length", *unusual]
    title = ", ".join(known[kind] for kind in kinds if kind in shared)
    room, baseline = across - 2 * margin, high - 1.9 * size
    if len(swims) == 1:
        room -= _draw_outcome(figure, swims[0], across - margin, baseline, size)
    title = shortened(title or f"{len(swims)} swims", room, 1.4 * size, bold=True)
    _write(figure, margin, baseline, title, 1.4 * size, INK, weight="bold")
    how = ONE if len(swims) == 1 else EACH
    for note in (f"{how} {BELOW}", BELOW, "time and distance"):
        if text_width(note, 0.9 * size) <= across - 2 * margin:
            _write(figure, margin, high - 3.5 * size, note, 0.9 * size, FAINT)
            return


def _draw_caption(figure: Figure, swim: Trajectory, name: str, layout: Layout, row: int) -> None:
    """What tells the row's swim from the others, and how it ended, above its moments."""
    box, size = layout.panels(row)[0], layout.text_size
    left, right = layout.margin, layout.size[0] - layout.margin
    baseline = box.y + box.height + 0.65 * size
    room = right - left - _draw_outcome(figure, swim, right, baseline, size)
    name = shortened(name, room, 1.1 * size, bold=True)
    _write(figure, left, baseline, name, 1.1 * size, INK, weight="bold")


def _draw_outcome(
    figure: Figure, swim: Trajectory, right: float, baseline: float, size: float
) -> float:
    """How the swim ended, up to the right edge; returns the width that it takes (pixels)."""
    time, closed = f"{swim.duration:.1f} s", f"{100 * swim.closed_fraction:.1f} % closed"
    words = f"goal reached in {time}" if swim.success else f"not reached in {time}, {closed}"
    if swim.target_moves:
        words = f"{100 * swim.distance.mean():.1f} cm from it on average, {time}"
    _write(figure, right, baseline, words, size, DONE if swim.success else INK, ha="right")
    return text_width(words, size) + size


def _draw_axis(figure: Figure, swim: Trajectory, boxes: list[Box], size: float) -> None:
    """The row's time axis: a tick, the time and the distance below each moment."""
    middle = [box.x + box.width / 2 for box in boxes]
    line, tick = boxes[0].y - 0.9 * size, 0.3 * size
    _line(figure, [middle[0], middle[-1]], [line, line], size)
    for x, time in zip(middle, _times(swim), strict=True):
        _line(figure, [x, x], [line - tick, line + tick], size)
        done = swim.success and time >= swim.duration
        centred = {"ha": "center"}
        clock = f"{time:.1f} s"
        _write(
            figure, x, line - 1.6 * size, clock, size, DONE if done else INK, weight="bold",
            **centred,
        )  # fmt: skip
        apart = _centimetres(float(swim.distance[round(time / swim.dt)]))
        _write(figure, x, line - 2.8 * size, apart, 0.95 * size, DONE if done else FAINT, **centred)


def _centimetres(metres: float) -> str:
    """A distance, to a millimetre below 10 cm."""
    return f"{100 * metres:.1f} cm" if metres < 0.0995 else f"{100 * metres:.0f} cm"


def _line(figure: Figure, x: list[float], y: list[float], size: float) -> None:
    line = Line2D(x, y, color=FAINT, linewidth=max(1.0, size / 14), transform=None)
    figure.add_artist(line)


def _write(
    figure: Figure, x: float, y: float, words: str, size: float, colour: Any, **look: Any
) -> None:
    """Words with their baseline at a height (pixels)."""
    across, high = figure.bbox.width, figure.bbox.height
    place = {"fontsize": size, "color": colour, "va": "baseline", "parse_math": False}
    figure.text(x / across, y / high, words, **{**place, **look})
