"""Figures of saved results: learning curves and zero-shot curves."""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
import pandas as pd
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from salpchain.errors import InputError
from salpchain.files import StrPath, read_json
from salpchain.report.picture import chains_picture
from salpchain.report.style import STYLE, legend_below, looks, percent_axes, save
from salpchain.report.transfer import transfer_figure

__all__ = ["chains_picture", "learning_curves", "over_seeds", "zero_shot"]


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
            for look, (name, logs) in zip(looks(), groups.items(), strict=False):
                _draw_curve(panel, look, name, over_seeds(logs, measure, window))
            panel.set_title(f"{measure.replace('_', ' ')} in training")
            panel.set_xlabel("million chain-steps")
            panel.set_xlim(left=0)
        percent_axes(panels, f"{window}-rollout mean ± standard error")
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
    names = [summary["policy"] for summary in summaries]
    with mpl.rc_context(STYLE):
        return save(transfer_figure(summaries, names), Path(out))


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
