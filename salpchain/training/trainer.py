"""Training runs: start, watch, stop, resume. The work of one iteration is in `learner`."""

import os
import signal
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp

from salpchain.devices import device_name, mesh_of
from salpchain.files import StrPath, alone, read_json
from salpchain.given import function, functions, path, seconds
from salpchain.switches import own_mesh
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.registry import make_task
from salpchain.tasks.task import Task
from salpchain.training import run_folder
from salpchain.training.checkpoint import CHECKPOINT_FILE, load_checkpoint, save_checkpoint
from salpchain.training.config import TrainConfig
from salpchain.training.learner import (
    TrainState,
    compile_iterate,
    divided_over,
    fresh_state,
    new_state,
    place,
)
from salpchain.training.metrics import evaluated, without_gaps
from salpchain.training.run_log import RunLog
from salpchain.training.settings import elsewhere
from salpchain.training.start import policy_to_start
from salpchain.world.config import WorldConfig

SAVE_EVERY = 20.0  # s between checkpoints (chosen)

COMPILING = "compiling"
EVALUATING = "evaluating the trained policy"

OnIteration = Callable[[Mapping[str, float], int], None]
OnIterations = OnIteration | Sequence[OnIteration] | None
OnStage = Callable[[str], None]


@own_mesh
def train(
    config: TrainConfig,
    run: StrPath,
    *,
    on_iteration: OnIterations = None,
    on_stage: OnStage | None = None,
    save_every: float = SAVE_EVERY,
    devices: int | None = None,
    task: "str | type[Task] | TaskConfig | None" = None,
    world: WorldConfig | str | None = None,
) -> dict[str, Any]:
    """A new run in a new folder; returns its summary.

    `task` and `world`, where given, take the place of those of the settings; a task given by name
    or class keeps their length, observation, action and time limit. After each iteration
    `on_iteration(metrics, step)` is called, or each of several such functions: `metrics` are
    numbers by the columns of `metrics.csv`, as far as they can be told yet, `step` the chain-steps
    so far. An evaluation comes in a call of its own, its names beginning with `evaluation_`. What a
    function raises stops the run after that iteration; all is saved. `on_stage(text)` is told what
    takes long. Chains are divided over as many devices as given or there are; rounding differs.

    Raises:
        InputError: no such settings, task, world or path, a used folder, or too few devices.
        NotFiniteError: a loss or weight is no longer a number; the last good checkpoint is kept.
        KeyboardInterrupt: asked to stop; everything is saved.
        Exception: whatever `on_iteration` raises; everything is saved.
    """
    config = elsewhere(config, task, world)
    run, listeners = _checked(run, save_every), Listeners.checked(on_iteration, on_stage)
    run_folder.check_free(run)
    session = Session([config], [run], divided_over(config, devices), listeners, save_every)
    policy_to_start(config)  # refused, if at all, before anything is written
    jax.eval_shape(partial(fresh_state, config, session.env))  # likewise
    run.mkdir(parents=True, exist_ok=True)
    with alone(run):  # from before its settings are written: of two, one has the folder
        _create(config, run, devices)
        listeners.stage(COMPILING)
        learner = new_state(config, session.env)
        save_checkpoint(learner, run)
        return _continue(session, [learner])[0]


def _checked(run: StrPath, save_every: float) -> Path:
    """The folder of a run.

    Raises:
        InputError: no path, or no time.
    """
    seconds("save_every", save_every)
    return path("run", run)


def _create(config: TrainConfig, run: Path, devices: int | None) -> int:
    devices = divided_over(config, devices)
    run_folder.create(run, config, devices, device_name())
    return devices


def _go_on(run: Path, config: TrainConfig, before: int, devices: int | None) -> tuple[int, str]:
    """Over how many devices a run goes on, and what there is to say of it; its settings say so.

    Over those that are asked for, otherwise over as many as before or as there are.

    Raises:
        InputError: fewer devices than asked for.
    """
    number = divided_over(config, before if devices is None else devices, or_fewer=devices is None)
    if number == before:
        return number, ""
    run_folder.change_devices(run, number, device_name())
    return number, (
        f"goes on over {number} instead of {before} devices: as good, but no longer bit for bit as"
        " if it had never stopped"
    )


@own_mesh
def resume(
    run: StrPath,
    *,
    on_iteration: OnIterations = None,
    on_stage: OnStage | None = None,
    save_every: float = SAVE_EVERY,
    devices: int | None = None,
) -> dict[str, Any]:
    """Goes on from the last whole checkpoint of a run, as if it had never stopped.

    A finished run is left as it is, and its summary returned. A run that was killed before its
    first checkpoint starts again. Over another number of devices, given or because fewer are there
    now, it goes on too, but sums are taken in another order. Functions are told as by `train`.

    Raises:
        InputError: no run folder, a damaged checkpoint, one written under other switches of JAX,
            fewer devices than given, or another process is at it.
    """
    run, listeners = _checked(run, save_every), Listeners.checked(on_iteration, on_stage)
    config, before = run_folder.read_config(run)
    if run_folder.is_finished(run):
        return read_json(run / run_folder.SUMMARY_FILE)
    with alone(run):
        devices, note = _go_on(run, config, before, devices)
        session = Session([config], [run], devices, listeners, save_every)
        learner = _saved_or_new(session.env, config, run)
        if int(learner.iteration) < config.iterations:
            listeners.stage(COMPILING)
            listeners.stage(note)
        return _continue(session, [learner])[0]


@own_mesh
def train_together(
    configs: Sequence[TrainConfig],
    runs: Sequence[StrPath],
    *,
    on_iteration: OnIterations = None,
    save_every: float = SAVE_EVERY,
    devices: int | None = None,
    patience: float = 0.0,
) -> None:
    """Runs that differ in their seeds alone, side by side in one compiled program.

    An accelerator that one run leaves idle serves them all in little more time. Each has a run
    folder of its own, as if alone. New runs are created and unfinished ones resumed; runs at the
    same iteration train together, and `on_iteration` is told the metrics of the first of them.
    `patience`: s to wait for another process that is at one of them.

    Raises:
        As `train` and `resume`. A run whose numbers are not finite stops nothing but itself.
    """
    runs, listeners = [Path(run) for run in runs], Listeners.checked(on_iteration)
    with ExitStack() as stack:
        for config, run in zip(configs, runs, strict=True):
            run.mkdir(parents=True, exist_ok=True)
            stack.enter_context(alone(run, patience))
            if not (run / run_folder.CONFIG_FILE).exists():
                _create(config, run, devices)
        before = [run_folder.read_config(run)[1] for run in runs]
        devices = min(_go_on(*each, devices)[0] for each in zip(runs, configs, before, strict=True))
        env = make_task(configs[0].task, configs[0].world)
        learners = [_saved_or_new(env, *both) for both in zip(configs, runs, strict=True)]
        come = [int(learner.iteration) for learner in learners]
        for iteration in sorted(set(come)):
            some = [i for i in range(len(runs)) if come[i] == iteration]
            session = Session(
                [configs[i] for i in some], [runs[i] for i in some], devices, listeners, save_every
            )
            _continue(session, [learners[i] for i in some])


def _saved_or_new(env: Task, config: TrainConfig, run: Path) -> TrainState:
    if (run / CHECKPOINT_FILE).exists():
        return load_checkpoint(run, jax.eval_shape(partial(fresh_state, config, env)))
    return new_state(config, env)


@dataclass
class Listeners:
    """Functions that are told how a training comes on, and the error of one that failed."""

    on_iteration: Sequence[OnIteration]
    on_stage: OnStage | None
    error: BaseException | None = field(default=None, init=False)

    @classmethod
    def checked(cls, on_iteration: OnIterations, on_stage: OnStage | None = None) -> "Listeners":
        """What the caller of a training gave.

        Raises:
            InputError: no functions.
        """
        return cls(functions("on_iteration", on_iteration), function("on_stage", on_stage))

    def iteration(self, values: Mapping[str, float], step: int, run: StrPath) -> None:
        """Tells the metrics at a step; after an error nothing more is told."""
        try:
            for call in self.on_iteration if not self.error else ():
                call(without_gaps(values), step)
        except BaseException as error:  # whatever it is, what was learned is saved first
            resume = f"salpchain.resume({os.fspath(run)!r}) goes on"
            error.add_note(f"on_iteration stopped the training at step {step:,}; {resume}")
            self.error = error

    def stage(self, text: str) -> None:
        """Tells what begins, if there is something to tell."""
        if self.on_stage and text:
            self.on_stage(text)


@dataclass(frozen=True)
class Session:
    """Settings that stay fixed from start or resume until the runs stop."""

    configs: list[TrainConfig]  # equal but for their seeds
    runs: list[Path]
    devices: int
    listeners: Listeners
    save_every: float  # s

    @property
    def env(self) -> Task:
        """The task of all."""
        return make_task(self.configs[0].task, self.configs[0].world)

    def tell(self, each: Sequence[Mapping[str, float] | None], iteration: int) -> None:
        """Tells the metrics of the first of several runs that has any."""
        first = next(((own, run) for own, run in zip(each, self.runs, strict=True) if own), None)
        if first:
            self.listeners.iteration(first[0], iteration * self.configs[0].ppo.batch, first[1])


def _continue(session: Session, learners: list[TrainState]) -> list[dict[str, Any]]:
    config, listeners = session.configs[0], session.listeners
    with _stop_on_signal() as stopped, _run_logs(session, int(learners[0].iteration)) as run_logs:
        come = _iterate(session, learners, run_logs, stopped)
        broken = [run_log.broken for run_log in run_logs if run_log.broken]
        if listeners.error:
            raise listeners.error
        if stopped() or (come < config.iterations and not broken):
            raise KeyboardInterrupt
        if come == config.iterations:
            listeners.stage(EVALUATING)
        done = [None if run_log.broken else run_log.finish() for run_log in run_logs]
        session.tell([x and evaluated(x["evaluation"]) for x in done], come)
    for error in [*broken, listeners.error]:
        if error:
            raise error
    return [summary for summary in done if summary]


@contextmanager
def _run_logs(session: Session, come: int) -> Iterator[list[RunLog]]:
    """The logs of runs at an iteration, open; closed at the end."""
    with ExitStack() as logs:
        run_logs = []
        for config, run in zip(session.configs, session.runs, strict=True):
            run_logs.append(RunLog(config, run, come))
            logs.callback(run_logs[-1].close)
        yield run_logs


def _iterate(
    session: Session,
    learners: list[TrainState],
    run_logs: list[RunLog],
    stopped: Callable[[], bool],
) -> int:
    """Iterations up to the last one, or until stopped; saves now and then. Returns the last."""
    config = session.configs[0]
    last = config.iterations
    first = int(learners[0].iteration)
    if first >= last or stopped():
        _save_each(run_logs, learners)  # killed between checkpoint and policy, it lacks the policy
        return first
    mesh = mesh_of(session.devices)
    learner = place(_stack(learners), mesh)
    step = compile_iterate(config, session.env, mesh, learner)
    for run_log in run_logs:
        run_log.clock.start_lap()
    saved = time.monotonic()
    for come in range(first + 1, last + 1):
        learner, metrics = step(learner)
        each = _unstack(jax.device_get(metrics), len(run_logs))
        rows = [run_log.add(come, own) for run_log, own in zip(run_logs, each, strict=True)]
        session.tell(rows, come)
        if config.is_evaluated_at(come):
            both = zip(run_logs, _unstack(learner, len(run_logs)), strict=True)
            session.tell([run_log.evaluate(come, own) for run_log, own in both], come)
        if stopped() or session.listeners.error or not any(rows):
            break
        if time.monotonic() - saved > session.save_every:
            _save(run_logs, learner)
            saved = time.monotonic()
    _save(run_logs, learner)
    return come  # type: ignore[possibly-unbound]


def _save(run_logs: Sequence[RunLog], learner: TrainState) -> None:
    _save_each(run_logs, _unstack(learner, len(run_logs)))


def _save_each(run_logs: Sequence[RunLog], learners: Sequence[TrainState]) -> None:
    for run_log, own in zip(run_logs, learners, strict=True):
        run_log.save(own)


def _stack(learners: Sequence[TrainState]) -> TrainState:
    """Several learners as one with a leading axis; a single one as it is."""
    if len(learners) == 1:
        return learners[0]
    return jax.tree.map(lambda *x: jnp.stack(x), *learners)


def _unstack(tree: Any, number: int) -> list[Any]:
    """Undoes `_stack`, for learners and what they give."""
    if number == 1:
        return [tree]
    return [jax.tree.map(lambda x, i=i: x[i], tree) for i in range(number)]


@contextmanager
def _stop_on_signal() -> Iterator[Callable[[], bool]]:
    """Ctrl-C and SIGTERM ask for a stop after the present iteration; a second Ctrl-C stops now.

    It is around the logs too: TensorBoard's, interrupted while it opens, would wait for ever
    at the end of the process.
    """
    asked = False

    def ask(number: int, frame: Any) -> None:
        nonlocal asked
        if asked:
            raise KeyboardInterrupt
        asked = True

    try:
        old = {s: signal.signal(s, ask) for s in (signal.SIGINT, signal.SIGTERM)}
    except ValueError:  # not the main thread: leave signals to whoever has them
        old = {}
    try:
        yield lambda: asked
    finally:
        for number, handler in old.items():
            signal.signal(number, handler)
