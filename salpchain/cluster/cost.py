"""What jobs cost: weights for the progress bar, and the estimate of a plan.

Imports nothing heavy: a plan is printed at once.
"""

from salpchain.cluster.grid import Grid, Job
from salpchain.domain.config import step_limit
from salpchain.machine import cores, jobs_that_fit

# Microseconds of one core for each unit (from trainings at 8 and 16 units, one on each of the two
# cores of an Intel Xeon; rough elsewhere): one control step, and one forward pass of a network.
STEP = 2.0
PASS = {"mlp": 0.2, "gcn": 3.2, "gatv2": 10.0, "gt": 16.5}
PAIR = {"mlp": 0.0, "gcn": 0.0, "gatv2": 0.4, "gt": 0.02}  # on full, for each unit that is heard
BACKWARD = 3  # forward and backward pass of a gradient, in forward passes
COMPILING = 40.0  # s of one core before a job starts
TRIALS_AT_ONCE = 0.5  # share of the longest episode that trials last on average
RUN_BYTES = 8_000_000  # of a run folder: checkpoint, policy, log, TensorBoard, tests


def train_cost(job: Job) -> float:
    """Seconds of one core that a training takes."""
    ppo, units = job.config.ppo, job.config.task.length
    passes = 1 + BACKWARD * ppo.epochs
    return COMPILING + job.config.total_steps * units * 1e-6 * (STEP + passes * _pass(job, units))


def test_cost(grid: Grid, job: Job, limit: str) -> float:
    """Seconds of one core that the tests of a run with one time limit take."""
    lengths = job.tests[limit]
    each = (n * step_limit(limit, n) * (STEP + _pass(job, n)) for n in lengths)
    return COMPILING + grid.trials * TRIALS_AT_ONCE * 1e-6 * sum(each)


def baseline_cost(grid: Grid) -> float:
    """Seconds of one core that the baseline's tests take."""
    steps = (n * step_limit(limit, n) for limit in grid.time_limits for n in grid.tests)
    return COMPILING + grid.trials * TRIALS_AT_ONCE * 1e-6 * STEP * sum(steps)


def _pass(job: Job, units: int) -> float:
    control = job.config.control
    heard = units if control.graph == "full" else 0
    return PASS[control.model] + PAIR[control.model] * heard


def plan(grid: Grid, jobs: int | None) -> str:
    """What a study would do, with an estimate of time and disk."""
    at_once = jobs or jobs_that_fit()
    lines = []
    for config in grid.configurations():
        job = next(j for j in grid.jobs() if j.config.name == config.name)
        each = train_cost(job) + sum(test_cost(grid, job, limit) for limit in job.tests)
        lines.append(
            f"{config.name:<16} {grid.seeds} x {config.total_steps:>12,} steps"
            f" {_hours(each):>12} of one core each"
        )
    total = baseline_cost(grid) + sum(
        train_cost(j) + sum(test_cost(grid, j, t) for t in j.tests) for j in grid.jobs()
    )
    disk = RUN_BYTES * len(grid.jobs()) / 1e9
    tests = f"{min(grid.tests)} to {max(grid.tests)}" if len(grid.tests) > 1 else min(grid.tests)
    return "\n".join(
        [
            f"preset {grid.preset}: {len(grid.jobs())} runs, then {grid.trials} trials at"
            f" {len(grid.tests)} lengths ({tests} units), limits {', '.join(grid.time_limits)}",
            *lines,
            f"about {_hours(total)} of one core: {_hours(total / cores())} on this machine's"
            f" {cores()} cores, {at_once} runs at a time; {disk:.1f} GB of disk",
        ]
    )


def _hours(seconds: float) -> str:
    return f"{seconds / 3600:.1f} h" if seconds >= 3600 else f"{seconds / 60:.0f} min"
