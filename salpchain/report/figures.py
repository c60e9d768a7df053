"""Figures of saved results: learning curves and zero-shot curves.

Colours are those of Okabe and Ito (2008), told apart by colour-blind people; each line also has
its own marker and dashes, so that the figures survive black and white print.
"""

import io
import json
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
import pandas as pd
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator, PercentFormatter

from salpchain.errors import InputError
from salpchain.files import StrPath, read_json, write_bytes
from salpchain.report.picture import chains_picture

__all__ = ["chains_picture", "learning_curves", "over_seeds", "zero_shot"]

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
LIMIT_NAMES = {"fixed": "512 steps", "scaled": "scaled time"}


class Curve(NamedTuple):
    """A mean over seeds against training steps, and its standard error."""

    steps: Float[np.ndarray, " point"]
    mean: Float[np.ndarray, " point"]
    error: Float[np.ndarray, " point"]


def learning_curves(runs: Sequence[StrPath], out: StrPath, window: int = 10) -> list[Path]:
    """Success and closed fraction against chain-steps, as PNG and PDF; returns both paths.

    Runs whose settings differ in nothing but the seed are one line: the mean over seeds, with its
    standard error as a band. Each run is first averaged over the episodes that ended in the last
    `window` rollouts. `out` is the path of either file; its suffix does not matter.

    Raises:
        InputError: no runs, or a folder without `config.json` or `metrics.csv`.
    """
    if not runs:
        raise InputError("learning curves need at least one run folder")
    groups = _group_by_settings([Path(run) for run in runs])
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9, 3.9), layout="constrained")
        panels = figure.subplots(1, 2, sharex=True, sharey=True)
        for panel, measure in zip(panels, ("success", "closed_fraction"), strict=True):
            for look, (name, logs) in zip(_looks(), groups.items(), strict=False):
                _draw_curve(panel, look, name, over_seeds(logs, measure, window))
            panel.set_title(f"{measure.replace('_', ' ')} in training")
            panel.set_xlabel("million chain-steps")
            panel.set_xlim(left=0)
        _percent_axes(panels, f"{window}-rollout mean ± standard error")
        legend_below(figure, panels[:1])
        return save(figure, out)


def over_seeds(logs: Sequence[pd.DataFrame], measure: str, window: int) -> Curve:
    """Mean and standard error over runs, at the steps that all of them have come to."""
    smooth = pd.concat([_running_mean(log, measure, window) for log in logs], axis=1).dropna()
    values = smooth.to_numpy(float)
    error = np.zeros(len(values))
    if values.shape[1] > 1:
        error = values.std(axis=1, ddof=1) / np.sqrt(values.shape[1])
    return Curve(smooth.index.to_numpy(float), values.mean(axis=1), error)


def _running_mean(log: pd.DataFrame, measure: str, window: int) -> pd.Series:
    """Mean over the episodes that ended in the last rollouts, by steps."""
    known = log[measure].notna()
    episodes = log["episodes"].where(known, 0.0)
    sums = pd.DataFrame({"total": log[measure].where(known, 0.0) * episodes, "episodes": episodes})
    total, count = np.asarray(sums.rolling(window, min_periods=1).sum(), float).T
    mean = np.divide(total, count, out=np.full_like(total, np.nan), where=count > 0)
    return pd.Series(mean, index=log["steps"])


def _group_by_settings(runs: Sequence[Path]) -> dict[str, list[pd.DataFrame]]:
    """The logs of the runs, those that differ only in their seed together, by a telling name."""
    groups: dict[str, list[Path]] = {}
    for run in runs:
        settings = _settings(run)
        settings.pop("seed", None)
        groups.setdefault(json.dumps(settings, sort_keys=True), []).append(run)
    flat = [_flatten(json.loads(key)) for key in groups]
    differ = [k for k in sorted(set().union(*flat)) if len({str(f.get(k)) for f in flat}) > 1]
    names = [_name(settings, differ) for settings in flat]
    logs = [[_read_log(run) for run in members] for members in groups.values()]
    seeds = [f" ({len(members)} seeds)" if len(members) > 1 else "" for members in logs]
    return {name + more: some for name, more, some in zip(names, seeds, logs, strict=True)}


def _settings(run: Path) -> dict[str, Any]:
    content = read_json(run / "config.json")
    if not (isinstance(content, dict) and isinstance(content.get("config"), dict)):
        raise InputError(f"{run / 'config.json'} does not describe a run")
    return dict(content["config"])


def _read_log(run: Path) -> pd.DataFrame:
    if not (run / "metrics.csv").is_file():
        raise InputError(f"{run} has no metrics.csv: give the folder of a training run")
    try:
        log = pd.read_csv(run / "metrics.csv")
    except (pd.errors.EmptyDataError, pd.errors.ParserError, UnicodeDecodeError) as error:
        raise InputError(f"{run / 'metrics.csv'} is not the log of a run ({error})") from None
    if not {"steps", "episodes", "success", "closed_fraction"} <= set(log.columns):
        raise InputError(f"{run / 'metrics.csv'} is not the log of a run: columns are missing")
    return log


def _flatten(values: dict[str, Any], before: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in values.items():
        inside = isinstance(value, dict)
        flat.update(_flatten(value, f"{before}{name}.") if inside else {before + name: value})
    return flat


def _name(settings: dict[str, Any], differ: Iterable[str]) -> str:
    """Model, graph and length, and whatever else tells a group from the others."""
    known = ("control.model", "control.graph", "task.length")
    name = " ".join(str(settings[k]) for k in known[:2] if k in settings) or "run"
    name += f", {settings[known[2]]} units" if known[2] in settings else ""
    more = [f"{k.split('.')[-1]} {settings.get(k)}" for k in differ if k not in known]
    return ", ".join([name, *more])


def _looks() -> Iterator[tuple[Any, str, Any]]:
    """Colour, marker and dashes for each line in turn; markers move on when colours are used up."""
    count = len(LOOKS)
    for turn in range(1000):
        colour, _, dashes = LOOKS[turn % count]
        yield colour, LOOKS[(turn + turn // count) % count][1], dashes


def _draw_curve(panel: Axes, look: Any, name: str, curve: Curve) -> None:
    colour, marker, dashes = look
    steps = curve.steps / 1e6
    low, high = curve.mean - curve.error, curve.mean + curve.error
    panel.fill_between(steps, low, high, color=colour, alpha=0.2, linewidth=0)
    every = (len(steps) // 20, max(1, len(steps) // 8))
    panel.plot(
        steps,
        curve.mean,
        color=colour,
        marker=marker,
        linestyle=dashes,
        markevery=every,
        label=name,
    )


def zero_shot(evaluations: Sequence[StrPath], out: StrPath) -> list[Path]:
    """Closed fraction and success against length, as PNG and PDF; returns both paths.

    `evaluations` are `evaluation.json` files or their folders. Bars are 95 % intervals. Beside
    the policies: the greedy baseline, the physical limit, the 90 % line, the training lengths.

    Raises:
        InputError: no evaluations, or a file that is none.
    """
    if not evaluations:
        raise InputError("zero-shot curves need at least one evaluation.json")
    summaries = [_read_evaluation(Path(path)) for path in evaluations]
    mixed = len({s["time_limit"] for s in summaries}) > 1
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9, 4.2), layout="constrained")
        panels = figure.subplots(1, 2, sharex=True, sharey=True)
        for panel, measure in zip(panels, ("closed_fraction", "success"), strict=True):
            for place, (look, summary) in enumerate(zip(_looks(), summaries, strict=False)):
                shift = 0.35 * (place - (len(summaries) - 1) / 2)
                name = summary["policy"] + _limit_name(summary, mixed)
                _draw_policy(panel, look, name, summary["lengths"], measure, shift)
            _draw_context(panel, summaries, measure, mixed)
            panel.set_title(measure.replace("_", " "))
            panel.set_xlabel("length (units)")
            panel.xaxis.set_major_locator(MaxNLocator(9, integer=True, steps=[1, 2, 4, 8, 10]))
        _percent_axes(panels, "mean over trials, 95 % interval")
        legend_below(figure, panels[:1])
        return save(figure, out)


def _read_evaluation(path: Path) -> dict[str, Any]:
    path = path / "evaluation.json" if path.is_dir() else path
    content = read_json(path)
    if not (isinstance(content, dict) and _is_evaluation(content)):
        raise InputError(f"{path} is not an evaluation: make one with salpchain evaluate")
    return content


def _is_evaluation(content: dict[str, Any]) -> bool:
    """Whether all is there that the figure draws."""
    drawn = {"length", "success", "closed_fraction", "reachable"}
    entries = content.get("lengths")
    return (
        {"policy", "time_limit"} <= content.keys()
        and isinstance(entries, list)
        and bool(entries)
        and all(isinstance(entry, dict) and drawn <= entry.keys() for entry in entries)
    )


def _limit_name(summary: dict[str, Any], mixed: bool) -> str:
    return f", {LIMIT_NAMES[summary['time_limit']]}" if mixed else ""


def _draw_context(panel: Axes, summaries: list[dict[str, Any]], measure: str, mixed: bool) -> None:
    """What the policies are seen against, once for each time limit."""
    panel.axhline(0.9, color=GREY, linewidth=0.8, linestyle=(0, (1, 2)))
    side, foot = panel.get_yaxis_transform(), panel.get_xaxis_transform()
    panel.text(1.005, 0.9, "90 %", color=GREY, fontsize=8, va="center", transform=side)
    for length in sorted({s["card"]["length"] for s in summaries if _was_trained(s)}):
        panel.axvline(length, color=GREY, linewidth=0.8, linestyle=(0, (4, 3)), zorder=0)
        note = f"trained on {length}"
        panel.text(
            length, 0.04, note, color=GREY, fontsize=8, rotation=90, ha="right", transform=foot
        )
    for dashes, summary in zip(("-", "--"), _one_for_each_limit(summaries), strict=False):
        more = _limit_name(summary, mixed)
        if summary.get("baseline"):
            look = (GREY, "p", dashes)
            _draw_policy(panel, look, f"greedy{more}", summary["baseline"]["lengths"], measure, 0.0)
        if measure == "closed_fraction":
            _draw_limit(panel, summary["lengths"], dashes, f"physical limit{more}")


def _was_trained(summary: dict[str, Any]) -> bool:
    return bool(summary.get("card", {}).get("steps"))


def _one_for_each_limit(summaries: list[dict[str, Any]]) -> Iterable[dict[str, Any]]:
    """For each time limit the evaluation of most lengths."""
    ordered = sorted(summaries, key=lambda s: len(s["lengths"]))
    return {s["time_limit"]: s for s in ordered}.values()


def _draw_limit(panel: Axes, entries: list[dict[str, Any]], dashes: str, name: str) -> None:
    lengths = [entry["length"] for entry in entries]
    limit = [entry["reachable"]["mean"] for entry in entries]
    panel.fill_between(lengths, limit, 1.0, color="#e4e4e4", linewidth=0, zorder=0)
    panel.plot(lengths, limit, color="#333333", linewidth=1.0, linestyle=dashes, label=name)


def _draw_policy(
    panel: Axes, look: Any, name: str, entries: list[dict[str, Any]], measure: str, shift: float
) -> None:
    """Mean and interval of a measure at each length, moved aside a little (units)."""
    colour, marker, dashes = look
    rows = [(entry["length"] + shift, *_bounds(entry[measure])) for entry in entries]
    lengths, mean, low, high = np.array(rows, float).T
    panel.errorbar(
        lengths, mean, (mean - low, high - mean), color=colour, marker=marker, linestyle=dashes,
        elinewidth=1.0, label=name, zorder=2 if colour == GREY else 3,
    )  # fmt: skip


def _bounds(value: dict[str, Any]) -> tuple[float, float, float]:
    """Mean, low and high; no interval is one of no width."""
    low, high = (value["mean"] if value[side] is None else value[side] for side in ("low", "high"))
    return value["mean"], low, high


def _percent_axes(panels: Iterable[Axes], label: str) -> None:
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
        drawn[path] = content.getvalue()
    for path, content in drawn.items():
        write_bytes(path, content)
    return list(drawn)
