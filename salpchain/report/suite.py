"""The page of a suite: a heat map of all cells, and a table for each trouble."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from salpchain.evaluation.suites import GRADES, STILL
from salpchain.files import StrPath
from salpchain.report.pages import Report, Table, write_report
from salpchain.report.style import STYLE, save

Cell = Mapping[str, Any]
NAME = "suite"
ABOUT = (
    "Success in percent, with 95 % Wilson intervals in the tables. Lost: success in still water"
    " from the same starts minus success here, in points, with the 95 % interval of paired trials."
    " Stayed: of the trials that reached the target, those that keep within 5 cm of it (mean over"
    " units) for 10 s more. Possible: the share of trials that physics allows at all, as far as is"
    " known. Time: median of steps to the goal over the fewest that physics allows in that world;"
    " nobody knows it in water that changes by chance or grows without a bound."
)


def suite_page(summary: Mapping[str, Any], out: StrPath) -> list[Path]:
    """`suite.md`, `suite.html` and the heat map as `suite.png` and `suite.pdf`, in the folder.

    `summary` is that of `run_suite`.
    """
    folder, cells = Path(out), summary["cells"]
    figures = heat_map(cells, folder / f"{NAME}.png")
    caption = f"Success of {summary['policy']} in each cell (percent)."
    report = Report(
        title=f"{summary['policy']} in suite {summary['suite']}",
        verdict=verdict(cells),
        about=[_about(summary), ABOUT],
        tables=[_table(trouble, _of(cells, trouble)) for trouble in _troubles(cells)],
        figures={caption: figures[0]},
    )
    return [*write_report(report, folder, NAME), *figures]


def verdict(cells: Sequence[Cell]) -> str:
    """One line: the mean success of each grade, and the worst cell."""
    parts = []
    for grade in GRADES:
        values = [_mean(cell) for cell in cells if cell["grade"] == grade]
        parts += [f"{grade} {100 * np.mean(values):.0f} %"] if values else []
    worst = min(cells, key=_mean)
    where = " ".join([worst["trouble"], *([worst["grade"]] if worst["trouble"] != STILL else [])])
    least = f"least {100 * _mean(worst):.0f} % ({where}, {worst['length']} units)"
    return f"Success, mean over cells: {', '.join(parts)}; {least}."


def heat_map(cells: Sequence[Cell], out: StrPath) -> list[Path]:
    """Success of each cell: a row for each trouble and grade, a column for each length."""
    rows = list(dict.fromkeys((cell["trouble"], cell["grade"]) for cell in cells))
    lengths = sorted({cell["length"] for cell in cells})
    values = np.full((len(rows), len(lengths)), np.nan)
    for cell in cells:
        place = rows.index((cell["trouble"], cell["grade"])), lengths.index(cell["length"])
        values[place] = 100 * _mean(cell)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(2.6 + 0.9 * len(lengths), 0.9 + 0.27 * len(rows)))
        panel = figure.add_subplot()
        panel.imshow(values, cmap="cividis", vmin=0, vmax=100, aspect="auto")
        panel.set_xticks(range(len(lengths)), [str(length) for length in lengths])
        panel.xaxis.tick_top()
        panel.set_xlabel("units")
        panel.xaxis.set_label_position("top")
        panel.set_yticks(range(len(rows)), [_row_name(*row) for row in rows])
        panel.tick_params(length=0)
        panel.spines[:].set_visible(False)
        for at, (trouble, _) in enumerate(rows):
            if at and trouble != rows[at - 1][0]:
                panel.axhline(at - 0.5, color="white", linewidth=2.5)
        for (row, column), value in np.ndenumerate(values):
            ink = "black" if value > 55 else "white"
            panel.text(column, row, f"{value:.0f}", ha="center", va="center", color=ink, size=9)
        figure.tight_layout(pad=0.4)
        return save(figure, out)


def _row_name(trouble: str, grade: str) -> str:
    return trouble if trouble == STILL else f"{trouble}, {grade}"


def _mean(cell: Cell) -> float:
    return cell["success"]["mean"]


def _troubles(cells: Sequence[Cell]) -> list[str]:
    return list(dict.fromkeys(cell["trouble"] for cell in cells))


def _of(cells: Sequence[Cell], trouble: str) -> list[Cell]:
    return [cell for cell in cells if cell["trouble"] == trouble]


def _about(summary: Mapping[str, Any]) -> str:
    lengths = ", ".join(map(str, summary["lengths"]))
    return (
        f"Suite `{summary['suite']}`, version {summary['version']}: {summary['trials']} trials in"
        f" each cell, {summary['time_limit']} time limit, seed {summary['seed']}, weights"
        f" `{summary['identity']}`, at {lengths} units. Every cell has the same starts."
    )


def _table(trouble: str, cells: Sequence[Cell]) -> Table:
    kinds = list(dict.fromkeys(kind for cell in cells for kind in cell.get("kinds", {})))
    columns = ["grade", "units", "success", "lost", "stayed", "possible", "closed", "time", *kinds]
    rows = []
    for cell in cells:
        loss, success = cell["loss"], cell["success"]
        each = [_percent_of(cell.get("kinds", {}), kind) for kind in kinds]
        rows.append(
            [
                cell["grade"],
                str(cell["length"]),
                _percents(success),
                _percents(loss),
                "-" if cell["stayed"] is None else _percents(cell["stayed"]),
                f"{100 * cell['possible']:.0f}",
                f"{100 * cell['closed_fraction']['mean']:.1f}",
                _ratio(cell["time_ratio"]["median"]),
                *each,
            ]
        )
    return Table(trouble, columns, rows)


def _percent_of(kinds: Mapping[str, Any], kind: str) -> str:
    return f"{100 * kinds[kind]['mean']:.0f}" if kind in kinds else "-"


def _percents(value: Mapping[str, float | None]) -> str:
    mean, low, high = value["mean"], value["low"], value["high"]
    assert mean is not None
    if low is None or high is None:
        return f"{100 * mean:.0f}"
    return f"{100 * mean:.0f} ({100 * low:.0f} to {100 * high:.0f})"


def _ratio(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"
