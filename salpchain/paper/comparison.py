"""A study beside what the paper measured."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from salpchain.paper.figures import normalised_curves
from salpchain.paper.reference import AT, FIGURE_3, FIGURE_4
from salpchain.paper.tables import Entry, zero_shot_table
from salpchain.report.pages import Table

SHOWN = (16, 24, 32, 40)  # units, of the table of Figure 4


def beside_figure_3(entries: Sequence[Entry]) -> Table:
    """Normalised return at the end of training, the mean over seeds, ours and the paper's."""
    rows = []
    for length in sorted({entry.length for entry in entries}):
        curves = normalised_curves([e for e in entries if e.length == length])
        for name, seeds in curves.items():
            theirs = FIGURE_3.get(length, {}).get(name)
            ours = float(seeds.iloc[-1].mean())
            rows.append([name, str(length), f"{ours:.2f}", "-" if theirs is None else f"{theirs}"])
    note = (
        "Each panel of Figure 3 has a scale of its own, from its lowest to its highest point, so"
        " the order within a training length can be compared, and little else."
    )
    columns = ["controller", "trained on", "here", "the paper"]
    return Table("Figure 3 beside the paper's: return at the end", columns, rows, note)


def beside_figure_4(entries: Sequence[Entry], time_limit: str) -> Table:
    """`paper-normalised` distance at some lengths, the mean over seeds, ours and the paper's."""
    table: Any = zero_shot_table([e for e in entries if e.model != "mlp"], time_limit)
    shown = [at for at in SHOWN if at in set(table["at"])]
    rows = []
    for (name, length), some in table.groupby(["controller", "length"], sort=False):
        ours = some.groupby("at")["paper_normalised"].mean()
        theirs = dict(zip(AT, FIGURE_4.get(length, {}).get(name, ()), strict=False))
        cells = [f"{_number(ours.get(at))} / {_number(theirs.get(at))}" for at in shown]
        rows.append([str(name), str(length), *cells])
    columns = ["controller", "trained on", *(f"{at} units" for at in shown)]
    note = (
        "Here / in the paper. Each controller is rescaled by its own best and worst length, so a"
        " controller that is good everywhere but at 64 units falls as one that is not."
    )
    return Table("Figure 4 beside the paper's: paper-normalised distance", columns, rows, note)


def _number(value: float | None) -> str:
    return "-" if value is None or np.isnan(value) else f"{value:.2f}"
