"""Evaluations that belong to a training: its policy, deterministic, at its own lengths."""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd

from salpchain.control.policy import Policy
from salpchain.evaluation.statistics import share
from salpchain.evaluation.trials import run_trials

SEED = 95  # of the starts; apart from those of `salpchain evaluate`, which judge (chosen)
TIME_LIMIT = "scaled"
TRIALS = 100  # episodes of a training on one length (chosen)
MANY_TRIALS = 200  # of all lengths together, of a training on several (chosen)
FEWEST = 20  # of each of several lengths (chosen)

Evaluation = dict[str, Any]


def evaluate_training(policy: Policy, lengths: Sequence[int]) -> Evaluation:
    """Success and closed fraction of the policy at these lengths, together and for each.

    `success` is {"mean", "low", "high"} with its 95 % Wilson interval, `closed_fraction` a mean,
    and `lengths` has the same for each length. The starts are the same for every training.
    """
    policy = jax.tree.map(jnp.asarray, jax.device_get(policy))  # off the devices of the training
    trials = TRIALS if len(lengths) == 1 else max(FEWEST, MANY_TRIALS // len(lengths))
    frames = [run_trials([policy], n, trials, TIME_LIMIT, SEED)[0] for n in lengths]
    each = [{"length": n, **_measures(own)} for n, own in zip(lengths, frames, strict=True)]
    about = {"time_limit": TIME_LIMIT, "seed": SEED}
    return {**_measures(pd.concat(frames)), **about, "lengths": each}


def _measures(rows: pd.DataFrame) -> dict[str, Any]:
    return {
        "trials": len(rows),
        "success": share(int(np.count_nonzero(rows["success"])), len(rows)),
        "closed_fraction": float(np.mean(rows["closed_fraction"])),
    }
