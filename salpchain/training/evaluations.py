"""Evaluations that belong to a training: its policy, deterministic, at its own lengths."""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd

from salpchain.controllers.policy import Policy
from salpchain.evaluation.starts import REACH
from salpchain.evaluation.statistics import own_measures, share
from salpchain.evaluation.trials import run_trials
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.registry import as_tested
from salpchain.world.config import WorldConfig
from salpchain.world.presets import as_config, label

SEED = 0  # of the starts: those of `salpchain evaluate`, which then tells the same (chosen)
TIME_LIMIT = "scaled"
TRIALS = 200  # episodes of all lengths together (chosen)
FEWEST = 20  # of each of several lengths (chosen)

Evaluation = dict[str, Any]


def evaluate_training(
    policy: Policy,
    lengths: Sequence[int],
    world: WorldConfig | str = "still",
    task: TaskConfig = REACH,
) -> Evaluation:
    """Success and closed fraction of the policy at these lengths, together and for each.

    `success` is {"mean", "low", "high"} with its 95 % Wilson interval, `closed_fraction` a mean,
    and `lengths` has the same for each length. The starts are the first ones of
    `salpchain evaluate`, the same for every training.
    """
    policy = jax.tree.map(jnp.asarray, jax.device_get(policy))  # off the devices of the training
    trials = max(FEWEST, TRIALS // len(lengths))
    asked, water = (trials, TIME_LIMIT, SEED), as_config(world)
    played = as_tested(task)
    frames = [run_trials([policy], n, *asked, world=water, task=played)[0] for n in lengths]
    each = [{"length": n, **_measures(own)} for n, own in zip(lengths, frames, strict=True)]
    about = {"time_limit": TIME_LIMIT, "seed": SEED, "world": label(water)}
    return {**_measures(pd.concat(frames)), **about, "lengths": each}


def _measures(rows: pd.DataFrame) -> dict[str, Any]:
    return {
        "trials": len(rows),
        "success": share(int(np.count_nonzero(rows["success"])), len(rows)),
        "closed_fraction": _mean(rows["closed_fraction"].to_numpy(float)),
        **{name: _mean(rows[name].to_numpy(float)) for name in own_measures(rows)},
    }


def _mean(values: np.ndarray) -> float | None:
    """The mean of the trials that have the measure."""
    there = values[np.isfinite(values)]
    return float(there.mean()) if len(there) else None
