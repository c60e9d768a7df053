"""The paper's claims, one by one, and whether they held in a study."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd

from salpchain.report.study import HELD, Entry, breakpoint_of, zero_shot_table

LAST = 0.1  # share of a training over which its end is averaged (chosen)
TIE = 0.01  # lead in success that tells nothing (chosen)
CLOSE = 0.05  # difference in success that counts as none (chosen)
LINEAR = 0.98  # squared correlation from which a decay counts as linear (chosen)
FEWEST = 4  # lengths beyond a breakpoint that say whether a decay is linear (chosen)


@dataclass(frozen=True)
class Claim:
    """What the paper says, and what the study saw."""

    text: str
    where: str  # in the paper
    held: bool | None  # None: the study cannot tell
    evidence: str


@dataclass(frozen=True)
class Facts:
    """What claims are judged by."""

    trained: pd.DataFrame  # rows: length; columns: controller; success at the end of training
    tests: pd.DataFrame  # zero_shot_table with the paper's time limit

    def success(self, name: str, length: int) -> float | None:
        """At the end of training, the mean over seeds; None if there is no such run."""
        if name not in self.trained.columns or length not in self.trained.index:
            return None
        value = float(self.trained.loc[length, name])  # type: ignore[arg-type]
        return None if np.isnan(value) else value

    def curve(self, name: str, length: int) -> Any:
        """The zero-shot rows of a controller that was trained on this length."""
        if self.tests.empty:
            return self.tests
        return self.tests[(self.tests.controller == name) & (self.tests.length == length)]


def facts(entries: Sequence[Entry], time_limit: str) -> Facts:
    """Of all runs, the tests with one time limit."""
    rows = [
        {"length": e.length, "controller": e.name, "success": success_at_end(e.log)}
        for e in entries
    ]
    trained = pd.DataFrame(rows).pivot_table(index="length", columns="controller", values="success")
    graphs = [entry for entry in entries if entry.model != "mlp"]
    return Facts(trained, zero_shot_table(graphs, time_limit))


def success_at_end(log: pd.DataFrame) -> float:
    """Of the episodes that ended in the last tenth of a training; NaN where none did."""
    rows = log.tail(max(1, round(LAST * len(log))))
    ended = rows[rows["episodes"] > 0]
    if ended.empty:
        return float("nan")
    return float(np.average(ended["success"], weights=ended["episodes"]))


def judge(known: Facts) -> list[Claim]:
    """Every claim for every training length of the study."""
    makers: list[Callable[[Facts, int], Claim]] = [
        transformers_train_best,
        simple_models_on_mixed_come_close,
        full_hurts_simple_models,
        transformer_minds_no_graph,
        breakpoint_at_twice,
        decay_is_linear,
    ]
    lengths = [int(length) for length in known.trained.index]
    claims = [make(known, length) for make in makers for length in lengths]
    return [*claims, *longer_training_serves_shorter_chains(known, lengths)]


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.1f} %"


def _listed(known: Facts, names: Sequence[str], length: int) -> str:
    return ", ".join(f"{name} {_percent(known.success(name, length))}" for name in names)


def transformers_train_best(known: Facts, length: int) -> Claim:
    """Section 5.1."""
    names = [str(name) for name in known.trained.columns]
    values = {n: v for n in names if (v := known.success(n, length)) is not None}
    ranked = sorted(values, key=lambda n: -values[n])
    held = None
    if {"gt mixed", "gt full"} <= values.keys() and len(values) > 2:
        others = max(v for n, v in values.items() if not n.startswith("gt "))
        lead = min(values["gt mixed"], values["gt full"]) - others
        held = lead > 0 if abs(lead) > TIE else None
    return Claim(
        f"{length} units: the graph transformer trains best, on both graphs",
        "section 5.1, Figure 3",
        held,
        f"success at the end of training: {_listed(known, ranked, length)} (a lead of less than"
        f" {100 * TIE:.0f} point tells nothing)",
    )


def simple_models_on_mixed_come_close(known: Facts, length: int) -> Claim:
    """Section 5.1."""
    names = ["gt mixed", "gcn mixed", "gatv2 mixed"]
    best, *others = (known.success(name, length) for name in names)
    held = None
    if best is not None and None not in others:
        held = all(best - value <= CLOSE for value in others if value is not None)
    return Claim(
        f"{length} units: gcn and gatv2 on mixed come close to the graph transformer",
        "section 5.1, Figure 3",
        held,
        f"{_listed(known, names, length)} (close: within {100 * CLOSE:.0f} points)",
    )


def full_hurts_simple_models(known: Facts, length: int) -> Claim:
    """Section 5.1: oversmoothing."""
    names = ["gcn mixed", "gcn full", "gatv2 mixed", "gatv2 full", "mlp"]
    values = {name: known.success(name, length) for name in names}
    held = None
    if None not in values.values():
        number = {name: value or 0.0 for name, value in values.items()}
        held = all(
            number[f"{model} full"] < min(number[f"{model} mixed"], number["mlp"])
            for model in ("gcn", "gatv2")
        )
    return Claim(
        f"{length} units: on full, gcn and gatv2 fall behind themselves on mixed and the mlp",
        "section 5.1, Figure 3",
        held,
        _listed(known, names, length),
    )


def transformer_minds_no_graph(known: Facts, length: int) -> Claim:
    """Sections 5.1 and 6."""
    one, other = (known.success(name, length) for name in ("gt mixed", "gt full"))
    held = None if one is None or other is None else abs(one - other) <= CLOSE
    return Claim(
        f"{length} units: the graph transformer does as well on full as on mixed",
        "sections 5.1 and 6",
        held,
        f"{_listed(known, ['gt mixed', 'gt full'], length)} (as well: within"
        f" {100 * CLOSE:.0f} points)",
    )


BEST = ("gt mixed", "gt full", "gcn mixed", "gatv2 mixed")  # the paper's best performers


def breakpoint_at_twice(known: Facts, length: int) -> Claim:
    """Section 5.2."""
    ends = {}
    for name in BEST:
        curve = known.curve(name, length)
        if not curve.empty:
            ends[name] = (
                breakpoint_of(curve, "paper_normalised"),
                breakpoint_of(curve, "closed_fraction"),
            )
    held = None
    if ends:
        held = all(end[0] is not None and end[0] >= 2 * length for end in ends.values())
    parts = [f"{name} {a or 'none'} ({b or 'none'} units)" for name, (a, b) in ends.items()]
    return Claim(
        f"trained on {length} units, the best controllers keep 90 % up to twice that",
        "section 5.2, Figure 4",
        held,
        "largest length, paper-normalised (by the share of the distance closed): "
        + (", ".join(parts) or "no tests"),
    )


def decay_is_linear(known: Facts, length: int) -> Claim:
    """Section 5.2."""
    fits = {}
    for name in BEST:
        curve = known.curve(name, length)
        if curve.empty:
            continue
        mean: Any = curve.groupby("at")["paper_normalised"].mean()
        last = breakpoint_of(curve, "paper_normalised") or 0
        beyond = mean[mean.index >= last]
        if len(beyond) >= FEWEST:
            fits[name] = float(np.corrcoef(beyond.index, beyond)[0, 1] ** 2)
    held = all(fit >= LINEAR for fit in fits.values()) if fits else None
    parts = [f"{name} {fit:.3f}" for name, fit in fits.items()]
    return Claim(
        f"trained on {length} units, performance decays linearly beyond the breakpoint",
        "section 5.2, Figure 4",
        held,
        f"squared correlation of paper-normalised distance and length (linear: {LINEAR} or more): "
        + (", ".join(parts) or f"fewer than {FEWEST} lengths beyond it"),
    )


def longer_training_serves_shorter_chains(known: Facts, lengths: Sequence[int]) -> list[Claim]:
    """Section 5.2."""
    claims = []
    for short, long in pairwise(lengths):
        parts, fine = [], []
        for name in BEST:
            curve = known.curve(name, long)
            rows = curve[curve["at"] <= long] if len(curve) else curve
            if len(rows):
                least = rows.groupby("at")["closed_fraction"].mean().min()
                parts.append(f"{name} {_percent(float(least))}")
                fine.append(least >= HELD)
        claims.append(
            Claim(
                f"trained on {long} units, the best controllers serve shorter chains too",
                "section 5.2, Figure 4",
                all(fine) if fine else None,
                f"least share of the distance closed at any length up to {long} (trained on"
                f" {short}: see above): " + (", ".join(parts) or "no tests"),
            )
        )
    return claims
