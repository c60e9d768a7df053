"""The look that all figures share: colours, axes of percents, legends, files.

Colours are those of Okabe and Ito (2008), told apart by colour-blind people; each line also has
its own marker and dashes, so that the figures survive black and white print.
"""

import io
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import PercentFormatter

from salpchain.errors import InputError
from salpchain.files import StrPath, write_bytes

STYLE: dict[Any, Any] = {
    "font.size": 10,
    "axes.labelsize": 11,
    "axes.titlesize": 12,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.8,
    "axes.axisbelow": True,
    "legend.frameon": False,
    "lines.linewidth": 1.6,
    "lines.markersize": 5.5,
    "lines.markeredgecolor": "white",
    "lines.markeredgewidth": 0.6,
    "pdf.fonttype": 42,
    "savefig.dpi": 200,
}
LOOKS = (
    ("#0072B2", "o", "-"),
    ("#D55E00", "s", (0, (5, 1.5))),
    ("#009E73", "^", (0, (1, 1))),
    ("#CC79A7", "D", (0, (4, 1, 1, 1))),
    ("#E69F00", "v", (0, (7, 1.5))),
    ("#56B4E9", "P", (0, (2, 1))),
    ("#000000", "X", (0, (6, 1, 1, 1, 1, 1))),
)
GREY = "#6b6b6b"


def looks() -> Iterator[tuple[Any, str, Any]]:
    """Colour, marker and dashes for each line in turn; markers move on when colours are used up."""
    count = len(LOOKS)
    for turn in range(1000):
        colour, _, dashes = LOOKS[turn % count]
        yield colour, LOOKS[(turn + turn // count) % count][1], dashes


def percent_axes(panels: Iterable[Axes], label: str) -> None:
    """One axis of percents for all panels, from 0 or below to 100."""
    panels = list(panels)
    panels[0].set_ylabel(label)
    lines = [np.asarray(line.get_ydata(), float) for p in panels for line in p.get_lines()]
    lowest = min([0.0, *(np.nanmin(y) for y in lines if len(y))])
    for panel in panels:
        panel.set_ylim(lowest - 0.02, 1.02)
        panel.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0, symbol=" %"))
        panel.grid(axis="y", color="#dddddd", linewidth=0.6)


def legend_below(figure: Figure, panels: Iterable[Axes]) -> None:
    """All lines that the panels name, each once, those with intervals first.

    In as many columns, up to five, as the figure is wide enough for.
    """
    pairs = [
        pair for panel in panels for pair in zip(*panel.get_legend_handles_labels(), strict=True)
    ]
    named = {label: handle for handle, label in reversed(pairs)}
    first = dict.fromkeys(label for _, label in pairs)
    labels = sorted(first, key=lambda label: isinstance(named[label], Line2D))
    handles = [named[label] for label in labels]
    place = {"loc": "outside lower center", "handlelength": 3.2}
    renderer = FigureCanvasAgg(figure).get_renderer()
    for columns in range(min(len(labels), 5), 0, -1):
        legend = figure.legend(handles, labels, ncols=columns, **place)
        if columns == 1 or legend.get_window_extent(renderer).width < figure.bbox.width:
            break
        legend.remove()


def save(figure: Figure, out: StrPath) -> list[Path]:
    """The figure at `out`, as PNG and PDF: whole or not there, and the same bytes each time."""
    out = Path(out)
    out.parent.mkdir(parents=True, exist_ok=True)
    drawn = {}
    for kind, metadata in (("png", {}), ("pdf", {"CreationDate": None})):
        content = io.BytesIO()
        figure.savefig(content, format=kind, metadata=metadata)
        path = out.with_suffix(f".{kind}")
        if path.is_dir():
            raise InputError(f"{path} is a folder: choose another name for the figure")
        drawn[path] = _with_palette(content) if kind == "png" else content.getvalue()
    for path, content in drawn.items():
        write_bytes(path, content)
    return list(drawn)


def _with_palette(png: io.BytesIO) -> bytes:
    """The picture in at most 256 colours, which a figure hardly needs, and a third of the space."""
    from PIL import Image

    with Image.open(png) as image:
        dots = image.info.get("dpi", (72, 72))
        few = image.convert("RGB").quantize(
            256, Image.Quantize.MEDIANCUT, kmeans=2, dither=Image.Dither.NONE
        )
    content = io.BytesIO()
    few.save(content, "png", optimize=True, dpi=dots)
    return content.getvalue()
