"""Best-known solutions in the real VMAS."""

import pytest
import torch

from salpchain.evaluation.best import solutions
from salpchain.evaluation.best.solutions import Solution
from salpchain.interop.best import in_vmas

torch.set_num_threads(1)


@pytest.mark.parametrize("length", [2, 4])
def test_solutions_take_their_targets_in_vmas_too(length):
    known = solutions.load(length)
    some = {number: known[number] for number in sorted(known)[:8]}
    assert in_vmas(length, some) == []


def test_a_solution_that_is_cut_short_is_found_out_in_vmas():
    known = solutions.load(2)
    short = Solution(known[3].thrusts[:-6], "me", "cut short")
    assert in_vmas(2, {1: known[1], 3: short}) == [3]
