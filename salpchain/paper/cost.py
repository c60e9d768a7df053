"""What jobs cost: weights for the progress bar, and the estimate of a plan.

Imports nothing heavy: a plan is printed at once.
"""

from collections.abc import Sequence

from salpchain.evaluation.config import programs
from salpchain.machine import cores, jobs_that_fit
from salpchain.paper.grid import Grid, Job
from salpchain.tasks.config import step_limit

# Microseconds of one core for each unit (from trainings at 8 and 16 units, one on each of the two
# cores of an AMD EPYC 9005; rough elsewhere): one control step, and one forward pass of a network.
STEP = 0.8
PASS = {"mlp": 0.07, "gcn": 1.2, "gatv2": 3.6, "gt": 5.4}
PAIR = {"mlp": 0.0, "gcn": 0.0, "gatv2": 0.12, "gt": 0.06}  # on full, for each unit that is heard
BACKWARD = 3  # forward and backward pass of a gradient, in forward passes
# Seconds of one core before a training, and before the tests of each size of batch, start; the
# second seed and those after it find the programs compiled.
COMPILING, COMPILED = 20.0, 4.0
TRIALS_AT_ONCE = 0.6  # share of the longest episode that trials last on average
RUN_BYTES = 8_000_000  # of a run folder: checkpoint, policy, log, TensorBoard, tests


def train_cost(job: Job) -> float:
    """Seconds of one core that a training takes."""
    ppo, units = job.config.ppo, job.config.task.length
    passes = 1 + BACKWARD * ppo.epochs
    work = job.config.total_steps * units * 1e-6 * (STEP + passes * _pass(job, units))
    return _start(job) + work


def test_cost(grid: Grid, job: Job) -> float:
    """Seconds of one core that the tests of a run take; all time limits are tested in one go."""
    lengths = next(iter(job.tests.values()), ())
    each = (n * _longest(grid, n) * (STEP + _pass(job, n)) for n in lengths)
    return programs(job.config.control.model, lengths) * _start(
        job
    ) + grid.trials * TRIALS_AT_ONCE * 1e-6 * sum(each)


def baseline_cost(grid: Grid) -> float:
    """Seconds of one core that the baseline's tests take."""
    steps = sum(n * _longest(grid, n) for n in grid.tests)
    return programs("", grid.tests) * COMPILING + grid.trials * TRIALS_AT_ONCE * 1e-6 * STEP * steps


def _start(job: Job) -> float:
    return COMPILED if job.config.seed else COMPILING


def _longest(grid: Grid, length: int) -> int:
    return max(step_limit(limit, length) for limit in grid.time_limits)


def _pass(job: Job, units: int) -> float:
    control = job.config.control
    heard = units if control.graph == "full" else 0
    return PASS[control.model] + PAIR[control.model] * heard


def plan(grid: Grid, jobs: int | None, left: Sequence[Job], baseline: bool) -> str:
    """What a study would do, with an estimate of time and disk for what is left of it.

    `left`: the jobs that are not done; `baseline`: whether the baseline's tests are not.
    """
    at_once = jobs or jobs_that_fit()
    lines = []
    for config in grid.configurations():
        job = next(j for j in grid.jobs() if j.config.policy_name == config.policy_name)
        each = train_cost(job) + test_cost(grid, job)
        lines.append(
            f"{config.policy_name:<16} {grid.seeds} x {config.total_steps:>12,} steps"
            f" {_hours(each):>12} of one core each"
        )
    total = sum(train_cost(job) + test_cost(grid, job) for job in left)
    total += baseline_cost(grid) if baseline else 0.0
    done = len(grid.jobs()) - len(left)
    disk = RUN_BYTES * len(left) / 1e9
    return "\n".join(
        [
            f"preset {grid.changed_preset}: {len(grid.jobs())} runs, then {_tests(grid)}, limits"
            f" {', '.join(grid.time_limits)}",
            *lines,
            *([f"{done} of {len(grid.jobs())} runs are done; what is left takes"] if done else []),
            f"about {_hours(total)} of one core: {_hours(total / cores())} on this machine's"
            f" {cores()} cores, {at_once} runs at a time; {disk:.1f} GB of disk",
        ]
    )


def _tests(grid: Grid) -> str:
    if len(grid.tests) == 1:
        return f"{grid.trials} trials at {grid.tests[0]} units"
    spread = f"{min(grid.tests)} to {max(grid.tests)} units"
    return f"{grid.trials} trials at {len(grid.tests)} lengths ({spread})"


def _hours(seconds: float) -> str:
    return f"{seconds / 3600:.1f} h" if seconds >= 3600 else f"{seconds / 60:.0f} min"
