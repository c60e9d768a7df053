"""What the table of best-known solutions says: how far they, and any-length, are from the bound."""

from dataclasses import dataclass
from functools import cache

import equinox as eqx
import jax
import numpy as np
import pandas as pd
from jaxtyping import Array, Int

from salpchain import given
from salpchain.errors import InputError
from salpchain.evaluation.best import starts
from salpchain.evaluation.best.play import SLOTS, poses
from salpchain.evaluation.best.solutions import Found
from salpchain.evaluation.turning import fewest_steps_turning
from salpchain.files import StrPath, read_json, write_json
from salpchain.physics.state import Chain, Physics
from salpchain.tasks.config import GOAL_LIMIT, step_limit

MOST = step_limit("scaled", max(starts.LENGTHS))  # control steps
REFERENCE = "any-length.json"  # the steps that the released policy takes


@dataclass(frozen=True)
class Row:
    """A length of the table; medians over the starts of which a solution is known."""

    length: int
    known: int  # starts with a solution
    best: float | None  # control steps
    bound: float | None  # control steps
    tightness: float | None  # bound over best
    regret: float | None  # any-length over best, where it takes the target


@cache
def bounds(length: int) -> Int[np.ndarray, " start"]:
    """Control steps before which no chain can be at the goal, of each start."""
    places = [(length, number) for number in range(starts.STARTS)]
    return np.asarray(_bounds(MOST, *poses(places, SLOTS[-1])))


@eqx.filter_jit
def _bounds(most: int, chains: Chain, targets: Array) -> Array:
    def bound(chain: Chain, target: Array) -> Array:
        return fewest_steps_turning(Physics(), chain, target, GOAL_LIMIT, most)

    return jax.vmap(bound)(chains, targets)


def row(length: int, found: Found, folder: StrPath = starts.FOLDER) -> Row:
    """A length of the table.

    Raises:
        InputError: the steps of any-length are damaged.
    """
    if not found:
        return Row(length, 0, None, None, None, None)
    gaps = each_start(length, found, folder)
    best, least, policy = gaps[["best", "bound", "any_length"]].to_numpy(float).T
    over = float(np.nanmedian(policy / best)) if np.isfinite(policy).any() else None
    medians = float(np.median(best)), float(np.median(least)), float(np.median(least / best))
    return Row(length, len(found), *medians, over)


def each_start(length: int, found: Found, folder: StrPath = starts.FOLDER) -> pd.DataFrame:
    """A row for each start that has a solution: `length`, `start`, and in control steps `best`,
    `bound` and `any_length` (NaN where it misses the target).

    Raises:
        InputError: the steps of any-length are damaged.
    """
    numbers = sorted(found)
    policy = np.array(reference(length, folder), float)[numbers]
    return pd.DataFrame(
        {
            "length": length,
            "start": numbers,
            "best": [found[number].steps for number in numbers],
            "bound": bounds(length)[numbers],
            "any_length": np.where(policy > 0, policy, np.nan),
        }
    )


def reference(length: int, folder: StrPath = starts.FOLDER) -> list[int]:
    """The control steps that any-length takes from each start, 0 where it misses the target.

    Raises:
        InputError: the file is damaged.
    """
    path = given.path("folder", folder) / REFERENCE
    steps = read_json(path)["steps"].get(str(length)) if path.exists() else None
    if steps is None:
        return [0] * starts.STARTS
    if len(steps) != starts.STARTS or not all(type(count) is int for count in steps):
        raise InputError(f"{path} is damaged: install salpchain again")
    return steps


def refers_to(length: int, identity: str, folder: StrPath = starts.FOLDER) -> bool:
    """Whether the steps that are kept for a length are those of this any-length."""
    path = given.path("folder", folder) / REFERENCE
    kept = read_json(path) if path.exists() else {"identity": "", "steps": {}}
    return kept["identity"] == identity and str(length) in kept["steps"]


def save_reference(length: int, steps: list[int], identity: str, folder: StrPath) -> None:
    """Keeps the steps of any-length, beside those that the same one takes at other lengths."""
    path = given.path("folder", folder) / REFERENCE
    kept = read_json(path) if path.exists() else {"identity": "", "steps": {}}
    kept = kept["steps"] if kept["identity"] == identity else {}
    kept[str(length)] = steps
    ordered = dict(sorted(kept.items(), key=lambda pair: int(pair[0])))
    write_json(path, {"policy": "any-length", "identity": identity, "steps": ordered})
