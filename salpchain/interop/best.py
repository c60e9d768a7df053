"""Best-known solutions in the real VMAS: its own physics, its own judge of the goal."""

from typing import Any

import numpy as np

from salpchain.evaluation.best import starts
from salpchain.evaluation.best.solutions import Found
from salpchain.interop.extras import need
from salpchain.interop.vmas import make_env
from salpchain.tasks.config import GOAL_LIMIT

need("torch", "vmas")

import torch

# m, beyond the goal's distance: joints that chatter make two runs part by tenths of a millimetre
# (VMAS from itself, started 1e-7 m away), contact by more.
SLACK = 0.002


def in_vmas(length: int, found: Found, slack: float = SLACK) -> list[int]:
    """The starts whose solutions do not come within the goal's distance and `slack` (m) of their
    targets in VMAS, all in one world.

    Raises:
        InputError: VMAS is not installed.
    """
    numbers = sorted(found)
    some, tolerance = starts.load(length), GOAL_LIMIT + slack
    env = make_env(
        len(numbers), length=length, tolerance=tolerance, time_limit="scaled", observation="table1"
    )
    env.reset()
    poses = some.position[numbers], some.angle[numbers], some.target[numbers]
    scenario: Any = env.scenario
    scenario.place(*(torch.from_numpy(np.array(pose)) for pose in poses))
    lasts = np.array([found[number].steps for number in numbers])
    thrusts = np.zeros((lasts.max(), len(numbers), length), np.float32)
    for i, number in enumerate(numbers):
        thrusts[: lasts[i], i] = found[number].newtons
    there = np.zeros(len(numbers), bool)
    for time, push in enumerate(torch.from_numpy(thrusts)):
        with torch.inference_mode():
            done = env.step([push[:, [unit]] for unit in range(length)])[2]
        there |= np.asarray(done) & (time < lasts)
        if there.all():
            break
    return [number for number, reached in zip(numbers, there, strict=True) if not reached]
