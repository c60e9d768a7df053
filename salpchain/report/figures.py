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
from matplotlib.ticker import MaxNLocator

from salpchain import given
from salpchain.errors import InputError
from salpchain.files import StrPath, read_json
from salpchain.report.judged import MEASURES, draw_evaluations
from salpchain.report.labels import check_once, labels
from salpchain.report.picture import chains_picture
from salpchain.report.style import GREY, STYLE, legend_below, looks, percent_axes, save
from salpchain.report.transfer import transfer_figure
from salpchain.training.config import TrainConfig
from salpchain.training.run_folder import CONFIG_FILE, check_run
from salpchain.training.settings import flat

__all__ = ["chains_picture", "learning_curves", "over_seeds", "zero_shot"]


TOO_EARLY = "in training: too early to tell, no start cohort is whole"


class Curve(NamedTuple):
    """A mean over seeds against training steps, and its standard error."""

    steps: Float[np.ndarray, " point"]
    mean: Float[np.ndarray, " point"]
    error: Float[np.ndarray, " point"]


def learning_curves(
    runs: StrPath | Sequence[StrPath], out: StrPath, window: int = 10
) -> list[Path]:
    """Success and closed fraction against chain-steps, as PNG and PDF; returns both paths.

    Lines are the success in training, of the policy as it explores; points are the deterministic
    evaluations on the way and the closing one, success with its 95 % interval. Runs whose settings
    differ in nothing but the seed are one line: the mean over seeds, with its standard error as a
    band, and so are their points. Each run is first averaged over the start cohorts that became
    whole in the last `window` rollouts. `out` is the path of either file; its suffix does not
    matter.

    Raises:
        InputError: no runs, or a folder without `config.json` or `metrics.csv`.
    """
    folders, out = given.paths("runs", runs), given.path("out", out)
    given.whole("window", window, least=1)
    groups = _group_by_settings(folders)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9, 4.2), layout="constrained")
        panels = figure.subplots(1, 2, sharex=True, sharey=True)
        for panel, measure in zip(panels, MEASURES, strict=True):
            _draw_learning(panel, groups, measure, window)
        error = " ± standard error" if any(len(runs) > 1 for runs in groups.values()) else ""
        percent_axes(panels, f"lines: in training,\n{window}-rollout mean{error}")
        legend_below(figure, panels[:1])
        return save(figure, out)


def _draw_learning(panel: Axes, groups: dict[str, list[Path]], measure: str, window: int) -> None:
    """The curves of a measure in training, and over them the evaluations."""
    panel.set_title(measure.replace("_", " "))
    for look, (name, runs) in zip(looks(), groups.items(), strict=False):
        logs = [_read_log(run) for run in runs]
        _draw_curve(panel, look, name, over_seeds(logs, measure, window))
    if not any(len(np.asarray(line.get_xdata())) for line in panel.get_lines()):
        panel.text(0.5, 0.02, TOO_EARLY, transform=panel.transAxes, ha="center", color=GREY)
    draw_evaluations(panel, list(groups.values()), measure)
    panel.xaxis.set_major_locator(MaxNLocator(6))
    panel.set_xlabel("million chain-steps")
    panel.set_xlim(left=0)


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


def _group_by_settings(runs: Sequence[Path]) -> dict[str, list[Path]]:
    """The runs, those that differ only in their seed together, by a telling name.

    Where a seed comes twice with the same settings, every run is a line of its own, by its folder.
    """
    check_once(runs)
    alike: dict[str, list[tuple[Any, Path]]] = {}
    for run in runs:
        settings = _settings(run)
        seed = settings.pop("seed", None)
        alike.setdefault(json.dumps(settings, sort_keys=True), []).append((seed, run))
    values = {key: json.loads(key) for key in alike}
    every = sorted(set().union(*values.values()))
    differ = [k for k in every if len({str(v.get(k)) for v in values.values()}) > 1]
    groups: list[tuple[str, list[Path]]] = []
    for key, members in alike.items():
        name, folders = _name(values[key], differ), [run for _, run in members]
        seeds = len({str(seed) for seed, _ in members})
        if seeds == len(members) > 1:
            groups.append((f"{name} ({seeds} seeds)", folders))
        else:
            groups += [(name, [run]) for run in folders]
    told = labels([name for name, _ in groups], [folders[0] for _, folders in groups])
    return {label: folders for label, (_, folders) in zip(told, groups, strict=True)}


def _settings(run: Path) -> dict[str, Any]:
    """Every setting of a run by its path; one that came later has its default."""
    content = read_json(check_run(run) / CONFIG_FILE)
    if not (isinstance(content, dict) and isinstance(content.get("config"), dict)):
        raise InputError(f"{run / 'config.json'} does not describe a run")
    return {**flat(TrainConfig()), **_flatten(content["config"])}


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
    """The policy's own name, or model, graph and length, and what else tells a group apart."""
    if settings["name"]:
        return settings["name"]
    known = ("control.model", "control.graph", "task.length")
    model, graph, length = (settings[k] for k in known)
    told = [k for k in differ if k not in (*known, "name")]
    if "world.name" in told:  # which says the world's other settings
        told = [k for k in told if not k.startswith("world.") or k == "world.name"]
    more = [f"{k.removesuffix('.name').split('.')[-1]} {settings.get(k)}" for k in told]
    return ", ".join([f"{model} {graph}, {length} units", *more])


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


def zero_shot(evaluations: StrPath | Sequence[StrPath], out: StrPath) -> list[Path]:
    """Closed fraction and success against length, as PNG and PDF; returns both paths.

    `evaluations` are `evaluation.json` files or their folders. Bars are 95 % intervals. Beside
    the policies: the greedy baseline, the physical limit, the 90 % line, the training lengths.

    Raises:
        InputError: no evaluations, or a file that is none.
    """
    files, out = given.paths("evaluations", evaluations), given.path("out", out)
    summaries = [_read_evaluation(path) for path in files]
    folders = [_folder_of(path) for path in files]
    check_once(folders)
    names = _names_of(summaries, folders)
    with mpl.rc_context(STYLE):
        return save(transfer_figure(summaries, names), out)


def _names_of(summaries: Sequence[dict[str, Any]], folders: Sequence[Path]) -> list[str]:
    """What the policies are called; those of one name by their folders.

    A single policy under several time limits keeps its name: the figure names the limits.
    """
    names = [summary["policy"] for summary in summaries]
    apart = list(names)
    for place, summary in enumerate(summaries):
        same = [other for other in summaries if other["policy"] == names[place]]
        whose = {other.get("identity") for other in same}
        limits = {other["time_limit"] for other in same}
        if len(whose) == 1 and None not in whose and len(limits) == len(same):
            apart[place] = f"{names[place]} {summary['time_limit']}"
    told = labels(apart, folders)
    return [
        name if label == alone else label
        for name, alone, label in zip(names, apart, told, strict=True)
    ]


def _folder_of(path: Path) -> Path:
    return path.parent if path.name == "evaluation.json" else path


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
