"""A canvas of pixels with antialiased shapes, by Agg; needs no display and no figure.

Matplotlib's figures would draw a few frames each second; its rasteriser alone draws hundreds.
"""

from collections.abc import Sequence
from functools import cache, lru_cache

import numpy as np
from jaxtyping import Float, UInt8
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.font_manager import FontProperties
from matplotlib.path import Path
from matplotlib.transforms import Bbox, IdentityTransform

Colour = Sequence[float] | np.ndarray  # red, green, blue in [0, 1]
Lines = Sequence[Float[np.ndarray, "point 2"]] | Float[np.ndarray, "line point 2"]

_AS_GIVEN = IdentityTransform()


@lru_cache(maxsize=4096)
def text_width(words: str, size: float, bold: bool = False) -> float:
    """Width (pixels) of a line of text as `Canvas.text` draws it."""
    return float(_ruler().get_text_width_height_descent(words, _font(size, bold), False)[0])


def shortened(words: str, room: float, size: float, bold: bool = False) -> str:
    """The text, with its middle left out where it is wider than the room (pixels)."""
    kept = len(words)
    shown = words
    while text_width(shown, size, bold) > room and kept > 1:
        kept -= 1
        tail = kept // 2
        shown = f"{words[: kept - tail]}…{words[len(words) - tail :]}"
    return shown


@cache
def _ruler() -> RendererAgg:
    return RendererAgg(1, 1, 72)


def _font(size: float, bold: bool) -> FontProperties:
    return FontProperties(size=size, weight="bold" if bold else "normal")


class Canvas:
    """Pixels of a size; x to the right and y upwards from the lower left corner, in pixels."""

    def __init__(self, width: int, height: int) -> None:
        """An empty canvas; 72 dots per inch, so that points are pixels."""
        self.width, self.height = width, height
        self._renderer = RendererAgg(width, height, 72)
        self._pen = self._renderer.new_gc()
        self._pen.set_antialiased(True)
        self._pen.set_capstyle("round")
        self._pen.set_joinstyle("round")
        self._pixels = np.asarray(self._renderer.buffer_rgba())

    def paste(self, pixels: UInt8[np.ndarray, "height width 4"]) -> None:
        """The canvas as it was when these pixels were copied."""
        self._pixels[:] = pixels

    @property
    def pixels(self) -> UInt8[np.ndarray, "height width 4"]:
        """Red, green, blue, alpha, the first row on top; they change when more is drawn."""
        return self._pixels

    def copy(self) -> UInt8[np.ndarray, "height width 4"]:
        """Its pixels as they are now."""
        return self._pixels.copy()

    def window(self, x: float, y: float, width: float, height: float) -> None:
        """From now on, draws in this rectangle only."""
        self._pen.set_clip_rectangle(Bbox.from_bounds(x, y, width, height))  # type: ignore[arg-type]

    def fill(self, outlines: Lines, colour: Colour, alpha: float = 1.0) -> None:
        """Closed shapes of one colour."""
        self._draw(outlines, colour, alpha, 0.0, closed=True, filled=True)

    def lines(self, lines: Lines, colour: Colour, width: float, alpha: float = 1.0) -> None:
        """Open lines of one colour and width (pixels)."""
        self._draw(lines, colour, alpha, width, closed=False, filled=False)

    def text(
        self, x: float, y: float, words: str, size: float, colour: Colour, **look: bool
    ) -> None:
        """Words with their baseline's left end at x, y; `bold`, or `right` to end there."""
        font = _font(size, look.get("bold", False))
        if look.get("right"):
            x -= text_width(words, size, look.get("bold", False))
        self._pen.set_foreground(_rgb(colour))
        self._pen.set_alpha(1.0)
        self._renderer.draw_text(self._pen, x, self.height - y, words, font, 0)

    def _draw(
        self, lines: Lines, colour: Colour, alpha: float, width: float, closed: bool, filled: bool
    ) -> None:
        if not len(lines):
            return
        self._pen.set_linewidth(width)
        self._pen.set_foreground(_rgb(colour))
        self._pen.set_alpha(alpha)
        face = (*_rgb(colour), alpha) if filled else None
        self._renderer.draw_path(self._pen, _path(lines, closed), _AS_GIVEN, face)


def _rgb(colour: Colour) -> tuple[float, float, float]:
    red, green, blue = colour
    return float(red), float(green), float(blue)


def _path(lines: Lines, closed: bool) -> Path:
    """All lines as one path, so that where they cross is not darker."""
    if isinstance(lines, np.ndarray):
        whole = np.concatenate([lines, lines[:, :1]], axis=1) if closed else lines
        points, starts = whole.reshape(-1, 2), np.arange(len(whole) + 1) * whole.shape[1]
    else:
        whole = [np.vstack([line, line[:1]]) if closed else line for line in lines]
        points, starts = np.vstack(whole), np.cumsum([0, *(len(line) for line in whole)])
    codes = np.full(len(points), Path.LINETO, Path.code_type)
    codes[starts[:-1]] = Path.MOVETO
    if closed:
        codes[starts[1:] - 1] = Path.CLOSEPOLY
    return Path(points, codes)
