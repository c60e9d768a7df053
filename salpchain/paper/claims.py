"""The paper's claims, one by one, and whether they held in a study."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from salpchain.paper.reference import AT, FIGURE_3, FIGURE_4
from salpchain.paper.tables import HELD, Entry, breakpoint_of, zero_shot_table

LAST = 0.1  # share of a training over which its end is averaged (chosen)
TIE = 0.01  # lead in success that tells nothing (chosen)
CLOSE = 0.05  # difference in success that counts as none (chosen)
LINEAR = 0.98  # squared correlation from which a decay counts as linear (chosen)
BEST = ("gt mixed", "gt full", "gcn mixed", "gatv2 mixed")  # the paper's best performers
ABOUT_CLAIMS = (
    "Success at the end of training: of the sampled policy, over the last tenth of the steps, ±"
    " the standard error over seeds. The best controllers are the paper's: gt on both graphs, gcn"
    " and gatv2 on mixed. Kept is what stays at 90 % or more at every shorter length too; needed is"
    " twice the training length, or what the paper's own curves come to by this rule where it is"
    " less."
)
NO_TESTS = "Not one of the best controllers has been tested yet."
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

    trained: pd.DataFrame  # rows: length, controller, seed, success at the end of training
    tests: pd.DataFrame  # zero_shot_table with the paper's time limit

    @property
    def lengths(self) -> list[int]:
        """Training lengths, ascending."""
        return sorted(int(length) for length in self.trained["length"].unique())

    def names(self, length: int) -> list[str]:
        """Controllers that were trained on this length."""
        own: Any = self.trained[self.trained["length"] == length]
        return list(own["controller"].unique())

    def success(self, name: str, length: int) -> float | None:
        """At the end of training, the mean over seeds; None if there is no such number."""
        value = float(self._of(name, length).mean())
        return None if np.isnan(value) else value

    def error(self, name: str, length: int) -> float | None:
        """Standard error of that mean; None with fewer than two seeds."""
        values = self._of(name, length).dropna()
        return float(values.sem()) if len(values) > 1 else None

    def _of(self, name: str, length: int) -> Any:
        table: Any = self.trained
        return table[(table["length"] == length) & (table["controller"] == name)]["success"]

    def curve(self, name: str, length: int) -> Any:
        """The zero-shot rows of a controller that was trained on this length."""
        if self.tests.empty:
            return self.tests
        return self.tests[(self.tests.controller == name) & (self.tests.length == length)]

    def curves(self, length: int) -> dict[str, Any]:
        """Those of the paper's best performers that were trained on this length and tested."""
        curves = {name: self.curve(name, length) for name in BEST}
        return {name: curve for name, curve in curves.items() if len(curve)}


def facts(entries: Sequence[Entry], time_limit: str) -> Facts:
    """The tests of all runs with one time limit."""
    rows = [
        {
            "length": entry.length,
            "controller": entry.name,
            "seed": entry.seed,
            "success": success_at_end(entry.log),
        }
        for entry in entries
    ]
    graphs = [entry for entry in entries if entry.model != "mlp"]
    return Facts(pd.DataFrame(rows), zero_shot_table(graphs, time_limit))


def success_at_end(log: pd.DataFrame) -> float:
    """The mean over episodes that ended in the last tenth of a training; NaN where none did."""
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
    lengths = known.lengths
    claims = [make(known, length) for make in makers for length in lengths]
    return [*claims, *longer_training_serves_shorter_chains(known, lengths)]


def _percent(value: float) -> str:
    return f"{100 * value:.1f} %"


def _listed(known: Facts, names: Sequence[str], length: int) -> str:
    """A sentence: the success of each, with its standard error and the paper's reward."""
    theirs = FIGURE_3.get(length, {})
    parts = [
        _trained(known, name, length) + (f" ({theirs[name]:g})" if name in theirs else "")
        for name in names
    ]
    beside = " (in brackets the paper's reward)" if theirs.keys() & set(names) else ""
    return f"Success at the end of training{beside}: {', '.join(parts)}."


def _trained(known: Facts, name: str, length: int) -> str:
    """A controller and its success, or why there is none."""
    success, error = known.success(name, length), known.error(name, length)
    if success is None:
        missing = "no episode has ended" if name in known.names(length) else "not trained"
        return f"{name} {missing}"
    return f"{name} {_percent(success)}" + ("" if error is None else f" ± {100 * error:.1f}")


def transformers_train_best(known: Facts, length: int) -> Claim:
    """Section 5.1."""
    values = {n: v for n in known.names(length) if (v := known.success(n, length)) is not None}
    ranked = sorted(known.names(length), key=lambda n: -values.get(n, -1.0))
    held = None
    if {"gt mixed", "gt full"} <= values.keys() and len(values) > 2:
        others = max(v for n, v in values.items() if not n.startswith("gt "))
        held = _ahead(min(values["gt mixed"], values["gt full"]), others)
    return Claim(
        f"{length} units: the graph transformer trains best, on both graphs",
        "section 5.1, Figure 3",
        held,
        f"{_listed(known, ranked, length)} A lead of less than {100 * TIE:.0f} point tells"
        " nothing.",
    )


def _ahead(one: float, other: float) -> bool | None:
    """Whether one success is above the other; None where the lead tells nothing."""
    return one > other if abs(one - other) > TIE else None


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
        f"{_listed(known, names, length)} Close means within {100 * CLOSE:.0f} points.",
    )


def full_hurts_simple_models(known: Facts, length: int) -> Claim:
    """Section 5.1: oversmoothing. In the paper they may equal themselves on mixed."""
    names = ["gcn mixed", "gcn full", "gatv2 mixed", "gatv2 full", "mlp"]
    values = {name: known.success(name, length) for name in names}
    held = None
    if None not in values.values():
        number = {name: value or 0.0 for name, value in values.items()}
        behind = [_ahead(number["mlp"], number[f"{model} full"]) for model in ("gcn", "gatv2")]
        above = [
            _ahead(number[f"{model} full"], number[f"{model} mixed"]) for model in ("gcn", "gatv2")
        ]
        refuted = False in behind or True in above
        held = False if refuted else None if None in behind else True
    return Claim(
        f"{length} units: on full, gcn and gatv2 fall behind the mlp, and are no better than on"
        " mixed",
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
        f"{_listed(known, ['gt mixed', 'gt full'], length)} As well means within"
        f" {100 * CLOSE:.0f} points.",
    )


def breakpoint_at_twice(known: Facts, length: int) -> Claim:
    """Section 5.2; needed is what the paper's own curves do by this rule, where it is less."""
    curves, theirs = known.curves(length), _papers_breakpoints(length)
    ends = {
        name: tuple(breakpoint_of(curve, m) or 0 for m in ("paper_normalised", "closed_fraction"))
        for name, curve in curves.items()
    }
    needed = min([2 * length, *theirs.values()])
    tested = all(curve["at"].max() >= 2 * length for curve in curves.values())
    held = None
    if len(curves) == len(BEST) and tested:
        held = all(end[0] >= needed for end in ends.values())
    parts = [
        f"{name} {a or 'none'} ({b or 'none'}; {theirs.get(name, 'unknown')})"
        for name, (a, b) in ends.items()
    ]
    evidence = (
        f"Largest length by paper-normalised distance, {needed} needed (in brackets that by the"
        f" share of the distance closed, and that of the paper's own curve): {', '.join(parts)}."
    )
    return Claim(
        f"trained on {length} units, the best controllers keep 90 % up to twice that",
        "section 5.2, Figure 4",
        held,
        evidence if parts else NO_TESTS,
    )


def _papers_breakpoints(length: int) -> dict[str, int]:
    """The last length before the first at which each of the paper's curves is below 90 %."""
    curves = FIGURE_4.get(length, {})
    below = {
        name: [at for at, value in zip(AT, curves[name], strict=True) if value < HELD]
        for name in BEST
        if name in curves
    }
    return {name: max(at for at in AT if at < min(some)) for name, some in below.items()}


def decay_is_linear(known: Facts, length: int) -> Claim:
    """Section 5.2."""
    fits = {}
    for name, curve in known.curves(length).items():
        mean: Any = curve.groupby("at")["paper_normalised"].mean()
        last = breakpoint_of(curve, "paper_normalised") or 0
        beyond = mean[mean.index >= last]
        if len(beyond) >= FEWEST:
            fits[name] = float(np.corrcoef(beyond.index, beyond)[0, 1])
    held = all(fit**2 >= LINEAR and fit < 0 for fit in fits.values()) if fits else None
    parts = [f"{name} {fit**2:.3f}{' (rising)' if fit > 0 else ''}" for name, fit in fits.items()]
    evidence = (
        "Squared correlation of paper-normalised distance and length beyond the breakpoint"
        f" ({LINEAR} or more counts as linear): {', '.join(parts)}."
    )
    few = f"Fewer than {FEWEST} lengths beyond the breakpoint were tested."
    return Claim(
        f"trained on {length} units, performance decays linearly beyond the breakpoint",
        "section 5.2, Figure 4",
        held if len(fits) == len(BEST) else None,
        evidence if parts else few if known.curves(length) else NO_TESTS,
    )


def longer_training_serves_shorter_chains(known: Facts, lengths: Sequence[int]) -> list[Claim]:
    """Section 5.2."""
    claims = []
    for long in lengths[1:]:
        parts, fine = [], []
        for name, curve in known.curves(long).items():
            rows = curve[curve["at"] <= long]
            if len(rows):
                least = float(rows.groupby("at")["closed_fraction"].mean().min())
                parts.append(f"{name} {_percent(least)}")
                fine.append(least >= HELD)
        claims.append(
            Claim(
                f"trained on {long} units, the best controllers serve shorter chains too",
                "section 5.2, Figure 4",
                all(fine) if len(fine) == len(BEST) else None,
                f"Least share of the distance closed at any length up to {long}"
                f" ({100 * HELD:.0f} % needed): {', '.join(parts)}."
                if parts
                else NO_TESTS,
            )
        )
    return claims
