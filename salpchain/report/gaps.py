"""The gaps picture: of each start, the steps of the best-known solution over the lower bound."""

import io

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from salpchain.files import StrPath, write_bytes
from salpchain.report.style import GREY, LOOKS, STYLE, legend_below

ACROSS = 4  # panels in a row


def gaps_picture(gaps: pd.DataFrame, out: StrPath) -> None:
    """A panel for each length: its starts, nearest target first, and three marks for each.

    `gaps` has `length`, `best`, `bound` and `any_length` (NaN where it misses) of each start, in
    control steps. `out` is the PNG.
    """
    lengths = list(dict.fromkeys(gaps["length"].tolist()))
    across = min(len(lengths), ACROSS)
    down = -(-len(lengths) // across)
    with mpl.rc_context(STYLE):
        size = (3.0 * across + 0.6, 2.5 * down + 0.7)
        figure = Figure(figsize=size, layout="constrained")
        panels = figure.subplots(down, across, squeeze=False).ravel()
        for panel, length in zip(panels, lengths, strict=False):
            _draw(panel, gaps.query("length == @length"), f"{length} units")
        for panel in panels[len(lengths) :]:
            panel.set_axis_off()
        figure.supylabel("control steps of 0.1 s", fontsize=11)
        legend_below(figure, panels[: len(lengths)])
        content = io.BytesIO()
        figure.savefig(content, format="png")
    write_bytes(out, content.getvalue())


def _draw(panel: Axes, starts: pd.DataFrame, title: str) -> None:
    """Bound, best-known and the released policy of each start of a length, and the median gap."""
    ordered = starts.sort_values(["bound", "best"]).to_dict("list")
    places = range(len(starts))
    best, policy, *_ = LOOKS
    panel.vlines(places, ordered["bound"], ordered["best"], color="#cccccc", linewidth=0.9)
    for column, name, (colour, marker, _) in (
        ("any_length", "any-length", policy),
        ("best", "best-known", best),
    ):
        panel.plot(places, ordered[column], marker, color=colour, markersize=3.2, label=name)
    panel.step(places, ordered["bound"], where="mid", color=GREY, label="no chain is sooner")
    panel.set_ylim(0)
    panel.set_xticks([])
    panel.set_xlabel("starts, by their bound", fontsize=9)
    panel.set_title(title)
    median = np.median(starts["bound"].to_numpy(float) / starts["best"].to_numpy(float))
    panel.set_title(f"bound / best {median:.2f}", loc="right", fontsize=9, color=GREY)
