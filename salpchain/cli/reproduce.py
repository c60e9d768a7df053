"""`salpchain reproduce`."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from salpchain.archive import restore
from salpchain.checks import one_of
from salpchain.cli.options import (
    Flag,
    Folder,
    Lengths,
    Name,
    Whole,
    number,
    positive,
    text_option,
    whole,
)
from salpchain.cli.settings import Sets
from salpchain.cli.streams import say
from salpchain.errors import InputError
from salpchain.evaluation.config import parse_lengths
from salpchain.files import alone, make_writable
from salpchain.networks.config import PAPER_GRAPHS, SINGLE_LENGTH
from salpchain.paper.grid import (
    DISABLED,
    PAPER_MODELS,
    PAPER_TESTS,
    Grid,
    Job,
    check_folder,
    claim,
)

if TYPE_CHECKING:
    from salpchain.experiments.sweep import Executor

EXECUTORS = ("local", "ray")
EXPERIMENTS = ("paper", "disabled")
Names = Annotated[str, text_option("NAME,NAME,...")]


@dataclass(frozen=True)
class Reproduce:
    """Repeat the paper: train every controller, test it at all lengths, draw, and report.

    Every model on every graph at every training length, with several seeds; then zero-shot trials
    at 4 to 64 units with both time limits, Figures 3 and 4, and a page that says, claim by claim,
    what held. Stopped or killed, the same command goes on; what is whole is not done again.

    `--experiment disabled` tests policies with some units disabled, as the original study's code
    does and the paper does not tell: how many may fail?

    Example: salpchain reproduce --preset quick --seeds 3 --out studies/mine
    """

    out: Folder = "study"
    """Folder of the study; new, empty, or one that this command began."""
    experiment: Annotated[str, text_option("paper|disabled")] = "paper"
    """paper (trains and tests), or disabled (tests policies; takes --policies, --lengths, --trials
    and --out, where it writes disabled/)."""
    policies: Names = ""
    """Policies to test with disabled units: names, run folders or files. Default: those that come
    with salpchain."""
    preset: Name = "quick"
    """quick (ours: minutes for each run) or paper (the paper's Table 2: hours to days for each)."""
    models: Names = "mlp,gcn,gatv2,gt"
    """Controllers."""
    graphs: Names = ""
    """Graphs of the graph controllers. Default: mixed,full."""
    lengths: Annotated[str, text_option("N,N,...")] = "8,16"
    """Training lengths."""
    seeds: Whole = "5"
    """Seeds of each configuration: 0, 1, 2, ... A study can be given more later."""
    steps: Whole = ""
    """Chain-steps of each run. Default: the preset's."""
    set: Sets = ()
    """A setting of every run, such as ppo.epochs=2, but those above; may be given several times."""
    trials: Whole = ""
    """Episodes of each test length. Default: 50; 25 of each number of disabled units."""
    tests: Lengths = ""
    """Lengths to test. Default: 4:64:4; without graph controllers, the training lengths."""
    jobs: Whole = ""
    """Runs at a time. Default: as many as fit this machine."""
    executor: Annotated[str, text_option("local|ray")] = "local"
    """local (processes on this machine) or ray (a cluster; needs the extra `cluster`)."""
    address: Annotated[str, text_option("HOST:PORT")] = ""
    """Address of the Ray cluster. Default: what RAY_ADDRESS names, otherwise a new one here."""
    cpus: Whole = ""
    """Cores for each run on Ray. Default: 1."""
    gpus: Annotated[str, text_option("SHARE")] = ""
    """Share of a GPU for each configuration on Ray, whose seeds then train side by side."""
    dry_run: Flag = False
    """Print the plan with an estimate of time and disk, and what is done already; do nothing."""


def run(options: Reproduce) -> int:
    """The whole study; 1 if a run failed for good, 2 if results were damaged."""
    one_of("experiment", options.experiment, EXPERIMENTS)
    if options.experiment == "disabled":
        return _disabled(options)
    if options.policies:
        raise InputError("--policies are tested with disabled units: add --experiment disabled")
    grid = grid_of(options)
    folder = Path(options.out)
    resources = _resources(options)
    check_folder(folder, grid)
    if number := restore(folder):
        say(f"unpacked {number} files of results in {folder}")
    if options.dry_run:
        from salpchain.paper.cost import plan

        print(plan(grid, resources.jobs, *_left(folder, grid)))
        return 0
    return _study(folder, grid, options, resources)


def _disabled(options: Reproduce) -> int:
    """The experiment with disabled units."""
    takes = {"out", "experiment", "policies", "lengths", "trials"}
    for one in fields(options):
        if one.name not in takes and getattr(options, one.name) != one.default:
            raise InputError(
                f"--experiment disabled trains nothing: leave --{one.name.replace('_', '-')} out"
            )
    lengths = parse_lengths(options.lengths)
    trials = positive("trials", options.trials) if options.trials else None
    from salpchain.cli.display import share_display
    from salpchain.controllers.released import PAPER_DYNAMICS, released
    from salpchain.controllers.storage import load
    from salpchain.devices import use_devices
    from salpchain.paper.disabled import TRIALS, experiment, jobs_of

    use_devices()
    names = options.policies or ",".join(released(PAPER_DYNAMICS))
    policies = [load(name) for name in _names("policies", names, ())]
    jobs_of(policies, lengths)  # refused, if at all, before anything is written
    out = Path(options.out) / DISABLED
    make_writable(out)
    with alone(out), share_display("testing") as watch:
        files = experiment(policies, lengths, trials or TRIALS, 0, out, watch)
    print(f"wrote {', '.join(map(str, files))}")
    return 0


def _left(folder: Path, grid: Grid) -> tuple[list[Job], bool]:
    """The jobs that are not done, and whether the baseline's tests are not."""
    if not folder.exists():
        return grid.jobs(), True
    from salpchain.paper.results import baseline_untested, is_done

    left = [job for job in grid.jobs() if not is_done(folder, job)]
    return left, bool(baseline_untested(folder, grid))


@dataclass(frozen=True)
class Resources:
    """What runs may take."""

    jobs: int | None  # at a time; None: as many as fit
    cpus: int  # cores of each, on Ray
    gpus: float  # share of a GPU for each configuration, on Ray


def _resources(options: Reproduce) -> Resources:
    one_of("executor", options.executor, EXECUTORS)
    for name in ("address", "cpus", "gpus"):
        if getattr(options, name) and options.executor != "ray":
            raise InputError(f"--{name} is for a Ray cluster: add --executor ray")
    return Resources(
        jobs=positive("jobs", options.jobs) if options.jobs else None,
        cpus=positive("cpus", options.cpus) if options.cpus else 1,
        gpus=_share_of_gpu(options.gpus),
    )


def grid_of(options: Reproduce) -> Grid:
    """The grid that the options ask for.

    Raises:
        InputError: invalid names or numbers.
    """
    models = _names("models", options.models, PAPER_MODELS)
    graphs = _names("graphs", options.graphs, PAPER_GRAPHS) if options.graphs else ()
    lengths = tuple(parse_lengths(options.lengths))
    tests = tuple(parse_lengths(options.tests)) if options.tests else lengths
    if any(model not in SINGLE_LENGTH for model in models):
        graphs = graphs or PAPER_GRAPHS
        tests = tests if options.tests else PAPER_TESTS
    return Grid(
        preset=options.preset,
        models=models,
        graphs=graphs,
        lengths=lengths,
        seeds=number("seeds", options.seeds),
        steps=whole("steps", options.steps),
        trials=positive("trials", options.trials or "50"),
        tests=tests,
        settings=tuple(sorted(options.set)),
    )


def _names(option: str, text: str, order: Sequence[str]) -> tuple[str, ...]:
    """The names that an option holds, in this order, so that theirs makes no other grid."""
    names = tuple(name.strip() for name in text.split(","))
    if "" in names:
        raise InputError(f"--{option} must be names with commas between, got {text!r}")
    return tuple(sorted(names, key=[*order, *names].index))


def _study(folder: Path, grid: Grid, options: Reproduce, resources: Resources) -> int:
    from salpchain.cli.display import sweep_display
    from salpchain.experiments.sweep import sweep
    from salpchain.paper.jobs import jobs_of
    from salpchain.paper.report import write_outcome
    from salpchain.paper.results import set_damaged_aside

    try:
        executor, together = _executor(options, resources)
    except KeyboardInterrupt:
        return _stopped()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with alone(folder):
            claim(folder, grid)
            damaged = set_damaged_aside(folder, grid)
            if damaged:
                *others, last = damaged
                for one in others:
                    print(f"salpchain: {one}", file=sys.stderr)
                raise InputError(f"{last}; the same command does again what was set aside")
            with sweep_display() as watch:
                failures = sweep(jobs_of(folder, grid, together), executor, watch)
            for line in failures:
                print(f"failed: {line}", file=sys.stderr)
            pages = write_outcome(folder, grid)
    except KeyboardInterrupt:
        return _stopped()
    finally:
        executor.stop()
    print(f"wrote {pages}")
    return 1 if failures else 0


def _stopped() -> int:
    say("stopped. The same command goes on where it was")
    return 130


def _executor(options: Reproduce, resources: Resources) -> "tuple[Executor, bool]":
    """Where runs go, and whether the seeds of a configuration train side by side."""
    jobs = resources.jobs
    if options.executor == "ray":
        from salpchain.experiments.on_ray import RayExecutor

        share = resources.gpus
        return RayExecutor(options.address, jobs, resources.cpus, share), share > 0
    from salpchain.experiments.local import LocalExecutor
    from salpchain.machine import gpus, jobs_that_fit

    there = gpus()
    return LocalExecutor(jobs or there or jobs_that_fit(), there), there > 0


def _share_of_gpu(text: str) -> float:
    """A part of one GPU, or a whole number of them; none if nothing is given."""
    try:
        share = float(text or 0)
    except ValueError:
        share = -1.0
    if not (0 <= share <= 1 or share.is_integer()) or share < 0:
        raise InputError(f"--gpus must be a share of 0 to 1, or a whole number, got {text}")
    return share
