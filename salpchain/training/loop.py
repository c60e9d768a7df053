"""A training loop of one's own: the iterations of `train`, one for each call."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp

from salpchain.controllers.policy import Policy
from salpchain.devices import mesh_of
from salpchain.errors import InputError
from salpchain.given import instance
from salpchain.switches import own_mesh
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.registry import make_task
from salpchain.tasks.task import Task
from salpchain.training.config import TrainConfig
from salpchain.training.learner import (
    Iterate,
    Metrics,
    TrainState,
    compile_iterate,
    divided_over,
    new_state,
    place,
    policy_of,
)
from salpchain.training.metrics import measured, not_finite, without_gaps
from salpchain.training.settings import elsewhere
from salpchain.world.config import WorldConfig


class _Program:
    """One iteration with the settings of a run, compiled at its first use."""

    def __init__(self, config: TrainConfig, devices: int) -> None:
        self.config, self.devices = config, devices
        self._run: Iterate | None = None

    def start(self) -> TrainState:
        """The state before the first iteration."""
        return place(new_state(self.config, self._env), mesh_of(self.devices))

    def run(self, state: TrainState) -> tuple[TrainState, Metrics]:
        """The state after one more iteration, and what that saw; the one given stays as it is."""
        if self._run is None:
            mesh = mesh_of(self.devices)
            self._run = compile_iterate(self.config, self._env, mesh, state, donate=False)
        return self._run(state)

    @property
    def _env(self) -> Task:
        return make_task(self.config.task, self.config.world)


@dataclass(frozen=True, eq=False, repr=False)
class Learner:
    """A policy in training, with all that its next iteration needs; `iterate` leaves it unchanged.

    `new_learner` makes one.
    """

    config: TrainConfig
    iteration: int  # rollouts with their updates so far
    _state: TrainState
    _program: _Program

    @property
    def steps(self) -> int:
        """Chain-steps of training so far."""
        return self.iteration * self.config.ppo.batch

    @property
    def policy(self) -> Policy:
        """The policy as it is now, for `save_policy`, `evaluate`, `record`."""
        state = jax.tree.map(jnp.asarray, jax.device_get(self._state.policy))
        return policy_of(self.config, state, self.steps)

    def __repr__(self) -> str:
        return f"Learner({self.config.policy_name}, {self.steps:,} steps)"


@own_mesh
def new_learner(
    config: TrainConfig,
    devices: int | None = None,
    task: "str | type[Task] | TaskConfig | None" = None,
    world: WorldConfig | str | None = None,
) -> Learner:
    """A learner before its first iteration; all randomness follows from `config.seed`.

    `task` and `world`, where given, take the place of those of the settings, as by `train`. Its
    chains are divided over as many devices as given, or as there are, as by `train`.

    Raises:
        InputError: no settings, no such task or world, or fewer devices than given.
    """
    config = elsewhere(config, task, world)
    program = _Program(config, divided_over(config, devices))
    return Learner(config, 0, program.start(), program)


@own_mesh
def iterate(learner: Learner) -> tuple[Learner, dict[str, float]]:
    """The learner after one more rollout and the update from it, and the metrics of both.

    The metrics are those of `metrics.csv` by the same names, without the times and without what it
    is too early to tell. After as many iterations as `train` makes (`config.iterations`), weights
    are the same bit for bit. The first call compiles.

    Raises:
        InputError: no learner, or one that has made all iterations of its settings.
        NotFiniteError: a loss or weight is no longer a number.
    """
    instance("learner", learner, Learner, "a learner, such as salpchain.new_learner(config)")
    config, come = learner.config, learner.iteration + 1
    if come > config.iterations:
        raise InputError(
            f"the learner has made all {config.iterations} iterations of its settings: give more"
            f" steps than {config.steps:,}, for its rates fall until then"
        )
    state, metrics = learner._program.run(learner._state)
    metrics = jax.device_get(metrics)
    error = not_finite(come, metrics, "the learner before it is as it was")
    if error:
        raise error
    after = Learner(config, come, state, learner._program)
    steps = {"iteration": float(come), "steps": float(after.steps)}
    return after, {**steps, **without_gaps(measured(config, metrics))}
