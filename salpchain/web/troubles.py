"""Troubles that a person can pour on live chains: those of the suite `sea`, in its grades.

They are the suite's single troubles but for finer substeps, which nobody sees. Where a trouble of
the suite has several worlds, `dropout` has the settings of both here, and `current` is the one that
changes in time. What the suite says of a length is that of `LENGTH` units.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cache
from typing import Any

from jaxtyping import Array, Int

from salpchain.checks import one_of
from salpchain.errors import InputError
from salpchain.evaluation.suites import GRADES, SUITES
from salpchain.given import told
from salpchain.world.among import chosen
from salpchain.world.config import NONE, WorldConfig

LENGTH = 12  # units (chosen: as many as the page begins with)
LEFT_OUT = ("substeps", "all")
CHOSEN_KIND = {"current": "changing"}  # of the worlds of a trouble, the one that is meant
TROUBLES = tuple(name for name in SUITES["sea"].troubles if name not in LEFT_OUT)
THRUSTERS = frozenset({"dead", "failing", "weak", "one-sided"})  # what they change is a unit's own

Changes = Mapping[str, Any]  # settings of a world by path, such as sensing.delay


def check_troubles(troubles: Iterable[str], grade: str) -> frozenset[str]:
    """The troubles as a set.

    Raises:
        InputError: an unknown trouble or grade.
    """
    found = list(troubles)
    for name in found:
        if name not in TROUBLES:
            raise InputError(f"unknown trouble {told(name)}: choose of {', '.join(TROUBLES)}")
    one_of("grade", grade, GRADES)
    return frozenset(found)


@cache
def worlds(base: WorldConfig) -> tuple[WorldConfig, ...]:
    """The world before anything is poured on it, and with every trouble in each grade.

    One that spares an episode some of its settings, as `sea` does, is still water here: what there
    is of it, the troubles decide. Jets that push one way in a share of the episodes always do so.
    """
    if base.spared.most > 0:
        base = replace(WorldConfig(), obstacles=base.obstacles)
    base = replace(base, thrusters=replace(base.thrusters, one_sided_share=1.0))
    every = [merged(base, _changes(grade).values()) for grade in range(len(GRADES))]
    return base, *every


def poured(base: WorldConfig, which: Mapping[str, Int[Array, ""]]) -> WorldConfig:
    """The world with these troubles: for each, 0 for none of it or its grade, from 1.

    All that are poured on one world are drawn with the same parts.
    """
    of_path = {
        f"world.{path}": trouble
        for trouble, changes in _changes(len(GRADES) - 1).items()
        for path in changes
    }
    return chosen(worlds(base), lambda path: which[of_path[path]])


def merged(base: WorldConfig, changes: Iterable[Changes]) -> WorldConfig:
    """A world with settings changed, by path."""
    parts: dict[str, dict[str, Any]] = {}
    for some in changes:
        for path, value in some.items():
            part, name = path.split(".")
            parts.setdefault(part, {})[name] = value
    own = {part: replace(getattr(base, part), **values) for part, values in parts.items()}
    return replace(base, spared=NONE, **own)


def _changes(grade: int) -> dict[str, dict[str, Any]]:
    """What each trouble changes in still water at a grade (0 to 2)."""
    found = {}
    for trouble in TROUBLES:
        kinds = SUITES["sea"].troubles[trouble](grade, LENGTH)
        if trouble in CHOSEN_KIND:
            kinds = {CHOSEN_KIND[trouble]: kinds[CHOSEN_KIND[trouble]]}
        changes: dict[str, Any] = {}
        for world in kinds.values():
            changes |= world.changes(WorldConfig())
        found[trouble] = changes
    return found
