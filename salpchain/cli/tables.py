"""Results as tables for the terminal."""

import math
from collections.abc import Mapping
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

Summary = Mapping[str, Any]  # of an evaluation, as in `evaluation.json`


def show(*tables: Table) -> None:
    """Prints tables that have rows; without blanks at the ends of lines where no terminal is."""
    console = Console()
    some = [table for table in tables if table.row_count]
    if console.is_terminal:
        console.print(*some)
        return
    with console.capture() as text:
        console.print(*some)
    print("\n".join(line.rstrip() for line in text.get().splitlines()))


def table(summary: Summary) -> Table:
    """The summary as a table of 80 columns: a row for each length, 95 % intervals in brackets."""
    baseline = summary.get("baseline")
    others = baseline["lengths"] if baseline else [None] * len(summary["lengths"])
    trials = max(entry["trials"] for entry in summary["lengths"])
    about = f"{trials} trials, {summary['time_limit']} time limit, seed {summary['seed']}"
    if summary.get("task", "reach") != "reach":
        about += f", task {escape(summary['task'])}"
    if summary.get("world", "still") != "still":
        about += f", world {escape(summary['world'])}"
    title = f"{summary['policy']}: {about}"
    if summary.get("measures"):
        return _own_table(summary, title, others)
    made = Table(
        title=title,
        caption="percent [95 % interval]; steps: median to the goal; time: median of steps over the"
        " fewest that physics allows; limit: what physics allows to be closed",
        title_justify="left",
        caption_justify="left",
        box=SIMPLE_HEAD,
        padding=0,
    )
    for name in ("length", "success", "closed", "steps", "time"):
        made.add_column(name, justify="right", no_wrap=True)
    for name in ("greedy\nsuccess", "greedy\nclosed") if baseline else ():
        made.add_column(name, justify="right")
    made.add_column("limit", justify="right")
    for own, other in zip(summary["lengths"], others, strict=True):
        made.add_row(*_cells(own, other))
    return made


def _own_table(summary: Summary, title: str, others: list[Any]) -> Table:
    """The measures of a task that has its own, and the baseline's beside the policy's: a row for
    each, however many there are."""
    made = Table(
        title=title,
        caption="means [95 % interval]; lengths in m, shares of 1",
        title_justify="left",
        caption_justify="left",
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
    )
    made.add_column("length", justify="right", no_wrap=True)
    made.add_column("measure", no_wrap=True)
    made.add_column(escape(summary["policy"]), justify="right")
    if summary.get("baseline"):
        made.add_column("greedy", justify="right")
    for own, other in zip(summary["lengths"], others, strict=True):
        for name in ("success", *summary["measures"]):
            cells = [_measured(row[name]) for row in (own, other) if row]
            length = str(own["length"]) if name == "success" else ""
            made.add_row(length, name.replace("_", " "), *cells)
        made.add_section()
    return made


def _measured(value: dict[str, Any]) -> str:
    """Mean and interval in three digits."""
    mean, low, high = (value[name] for name in ("mean", "low", "high"))
    if mean is None:
        return "-"
    if low is None or low == high:
        return f"{mean:.3g}"
    return escape(f"{mean:.3g} [{low:.3g}, {high:.3g}]")


ASKED = {
    "far": "distance (chain lengths)",
    "turn": "turn of the target (degrees)",
    "bend": "bend of the target (degrees)",
}


def difficulty_table(summary: Summary) -> Table:
    """The trials in thirds of each length's, by what makes them hard; no rows if nothing does."""
    made = Table(
        title="by difficulty, in thirds of each length's trials",
        caption="means; success with its 95 % interval; time: median steps to the goal over the"
        " fewest that physics allows",
        title_justify="left",
        box=SIMPLE_HEAD,
        pad_edge=False,
    )
    made.add_column("by")
    for name in ("mean", "success", "closed", "time"):
        made.add_column(name, justify="right", no_wrap=True)
    for name, thirds in summary["by_difficulty"].items():
        for place, third in enumerate(thirds):
            scale, unit = (1, ".1f") if name == "far" else (180 / math.pi, ".0f")
            made.add_row(
                ASKED[name] if place == 0 else "",
                f"{scale * third['mean']:{unit}}",
                _percent(third["success"], 0),
                f"{100 * third['closed_fraction']:.1f}",
                _ratio(third["time_ratio"]),
            )
    return made


def _cells(own: Summary, other: Summary | None) -> list[str]:
    cells = [str(own["length"]), _percent(own["success"], 0), _percent(own["closed_fraction"], 1)]
    cells += [_steps(own["steps_to_goal"]["median"]), _ratio(own["time_ratio"]["median"])]
    if other:
        greedy = other["success"]["mean"], other["closed_fraction"]["mean"]
        cells += [f"{100 * greedy[0]:.0f}", f"{100 * greedy[1]:.1f}"]
    limit = own["reachable"]["mean"]
    return [*cells, "-" if limit is None else f"{100 * limit:.1f}"]


def _steps(median: float | None) -> str:
    """Half steps, which a median may have, are shown."""
    return "-" if median is None else f"{median:g}"


def _ratio(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def _percent(value: dict[str, Any], digits: int) -> str:
    """Mean and interval in percent."""
    mean, low, high = (value[name] for name in ("mean", "low", "high"))
    text = f"{100 * mean:.{digits}f}"
    if low is None:
        return text
    return escape(f"{text} [{100 * low:.{digits}f}, {100 * high:.{digits}f}]")
