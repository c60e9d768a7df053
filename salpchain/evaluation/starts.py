"""What trials begin from: the task at their length, and a start for each number."""

from collections.abc import Sequence
from dataclasses import replace

import jax
import jax.random as jr
from jaxtyping import Array, Int, Key

from salpchain.checks import check_length
from salpchain.controllers.policy import Controller, Planner
from salpchain.errors import InputError
from salpchain.evaluation.config import SLOTS
from salpchain.networks.config import SINGLE_LENGTH
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.registry import make_task
from salpchain.tasks.task import Task
from salpchain.world.randomise import WorldLike, as_world

REACH = TaskConfig()
STREAM = 0x5C1D  # sets the starts of trials apart from every key of training (chosen)


def domain_for(
    controllers: Sequence[Controller],
    length: int,
    time_limit: str,
    world: WorldLike = "still",
    task: TaskConfig = REACH,
) -> Task:
    """The task with as many slots as the length needs, few different numbers in all.

    Raises:
        InputError: a length that a controller cannot serve, or controllers of different
            observations or actions.
    """
    cards = [controller.card for controller in controllers]
    for card in cards:
        card.check_serves(check_length(length))
    task.check_possible(length)
    spoken = {(card.observation, card.action) for card in cards}
    if len(spoken) != 1:
        raise InputError(f"controllers must share observation and action, got {sorted(spoken)}")
    slots = next(slots for slots in SLOTS if slots >= length)
    if any(card.control.model in SINGLE_LENGTH for card in cards) or any(
        isinstance(controller, Planner) for controller in controllers
    ):  # a planner pays for each slot many times over
        slots = length
    observation, action = spoken.pop()
    asked = {"length": slots, "observation": observation, "action": action}
    return make_task(replace(task, **asked, time_limit=time_limit), as_world(world))


def start_keys(seed: int, length: int, trials: Int[Array, " trial"]) -> Key[Array, " trial"]:
    """One key for each trial number, the same whatever the controller or the other trials."""
    root = jr.fold_in(jr.fold_in(jr.key(seed, impl="threefry2x32"), STREAM), length)
    return jax.vmap(lambda trial: jr.fold_in(root, trial))(trials)
