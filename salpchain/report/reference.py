"""What the paper measured, read off its Figures 3 and 4, and a study beside it."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from salpchain.report.pages import Table
from salpchain.report.paper_figures import normalised_curves
from salpchain.report.study import Entry, zero_shot_table

AT = tuple(range(4, 41, 4))  # units
# Figure 4, paper-normalised distance at these lengths, by training length.
FIGURE_4: dict[int, dict[str, tuple[float, ...]]] = {
    8: {
        "gt mixed": (1, 1, 0.983, 0.973, 0.917, 0.839, 0.741, 0.640, 0.550, 0.458),
        "gatv2 mixed": (1, 1, 0.984, 0.971, 0.896, 0.820, 0.739, 0.650, 0.558, 0.474),
        "gcn mixed": (1, 1, 0.983, 0.965, 0.861, 0.788, 0.684, 0.596, 0.519, 0.450),
        "gt full": (1, 1, 0.985, 0.968, 0.914, 0.839, 0.748, 0.650, 0.562, 0.468),
        "gatv2 full": (1, 1, 0.953, 0.875, 0.791, 0.716, 0.642, 0.574, 0.506, 0.436),
        "gcn full": (1, 0.950, 0.893, 0.839, 0.782, 0.717, 0.649, 0.577, 0.507, 0.435),
    },
    16: {
        "gt mixed": (1, 0.995, 0.995, 0.994, 0.990, 0.977, 0.940, 0.884, 0.772, 0.667),
        "gatv2 mixed": (1, 1, 0.997, 0.999, 0.982, 0.951, 0.908, 0.844, 0.731, 0.645),
        "gcn mixed": (1, 0.997, 0.995, 0.996, 0.990, 0.971, 0.938, 0.883, 0.790, 0.693),
        "gt full": (1, 0.998, 0.995, 0.987, 0.985, 0.969, 0.928, 0.877, 0.757, 0.651),
        "gatv2 full": (1, 0.995, 0.956, 0.917, 0.858, 0.784, 0.715, 0.639, 0.554, 0.471),
        "gcn full": (1, 0.945, 0.893, 0.840, 0.785, 0.727, 0.668, 0.608, 0.543, 0.475),
    },
}
# Figure 3, normalised reward at the end of training, by training length.
FIGURE_3: dict[int, dict[str, float]] = {
    8: {
        "gt mixed": 0.96, "gt full": 0.965, "mlp": 0.93, "gcn mixed": 0.90,
        "gatv2 mixed": 0.83, "gatv2 full": 0.83, "gcn full": 0.77,
    },
    16: {
        "gcn mixed": 0.95, "gt full": 0.94, "mlp": 0.94, "gt mixed": 0.94,
        "gatv2 mixed": 0.92, "gcn full": 0.91, "gatv2 full": 0.855,
    },
}  # fmt: skip
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
    rows = []
    for (name, length), some in table.groupby(["controller", "length"], sort=False):
        ours = some.groupby("at")["paper_normalised"].mean()
        theirs = dict(zip(AT, FIGURE_4.get(length, {}).get(name, ()), strict=False))
        cells = [f"{_number(ours.get(at))} / {_number(theirs.get(at))}" for at in SHOWN]
        rows.append([str(name), str(length), *cells])
    columns = ["controller", "trained on", *(f"{at} units" for at in SHOWN)]
    note = (
        "Here / in the paper. Each controller is rescaled by its own best and worst length, so a"
        " controller that is good everywhere but at 64 units falls as one that is not."
    )
    return Table("Figure 4 beside the paper's: paper-normalised distance", columns, rows, note)


def _number(value: float | None) -> str:
    return "-" if value is None or np.isnan(value) else f"{value:.2f}"
