"""`salpchain evaluate`."""

from dataclasses import dataclass
from json import dumps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from salpchain.checks import check_seed, one_of
from salpchain.cli.options import (
    Flag,
    Folder,
    Lengths,
    Task,
    Whole,
    World,
    number,
    positive,
    text_option,
)
from salpchain.cli.recordings import say_if_trained_elsewhere
from salpchain.cli.settings import Sets, changed
from salpchain.cli.streams import say
from salpchain.controllers.named import check_there, is_name, load
from salpchain.errors import InputError
from salpchain.evaluation.config import parse_lengths, programs
from salpchain.evaluation.suites import suite
from salpchain.plugins import is_path
from salpchain.tasks.config import TIME_LIMITS
from salpchain.world.presets import world_config

LENGTHS, TRIALS = "4:64:4", "50"  # where no suite says

if TYPE_CHECKING:
    from salpchain.controllers.policy import Controller


@dataclass(frozen=True)
class Evaluate:
    """Test a policy, unchanged, on chains of many lengths, beside the greedy baseline.

    Every length is played from the same random starts, whatever the policy. A row for each trial
    goes to evaluation.csv, means, medians and 95 % intervals by length to evaluation.json;
    docs/evaluate.md says what each column means.

    mpc plans anew in every control step, which takes minutes for a few chains.

    Example: salpchain evaluate runs/eight --lengths 4:64:4 --out results/eight
    """

    policy: tyro.conf.Positional[Annotated[str, text_option("RUN_OR_POLICY")]] = ""
    """A run folder, a policy.safetensors, or a name that `salpchain models` lists.
    A name wins over a folder that is called so: write ./NAME for the folder."""
    lengths: Lengths = ""
    """Lengths to play, the last included. Default: 4:64:4, of a suite its own."""
    trials: Whole = ""
    """Episodes of each length, of a suite of each of its cells. Default: 50, of a suite its own."""
    suite: Annotated[str, text_option("NAME")] = ""
    """Judge it in a fixed set of worlds instead: sea (currents, dead thrusters, noise, delay and
    more in three grades; docs/suite.md). Writes suite.json, suite.csv and a page."""
    time_limit: Annotated[str, text_option("scaled|fixed")] = "scaled"
    """scaled (32 steps for each unit, at least 512) or fixed (512 steps, the paper's)."""
    seed: Whole = "0"
    """Seed of the starts; keep it apart from the seeds of training."""
    task: Task = ""
    """What it is to do: reach (the paper's: take a target pose), follow (a target that moves),
    dock, passage or gather (docs/tasks.md), or one of your own, module:Class. Default: what the
    policy was trained for."""
    world: World = "still"
    set: Sets = ()
    """Any number of the task or the world, such as task.speed=0.1 or world.current.speed=0:0.08;
    may be given several times. docs/settings.md lists them."""
    out: Folder = ""
    """Folder for the files. Results in it of another policy, or of other trials, are kept and
    these are refused. Default: evaluation in the run folder (of a suite its name), else
    evaluation-NAME (SUITE-NAME) in the working folder."""
    overwrite: Flag = False
    """Replace whatever results --out holds."""
    json: Flag = False
    """Print the summary, as in evaluation.json, as JSON alone."""


def run(options: Evaluate) -> None:
    """Plays all trials and prints the table."""
    if not options.policy:
        raise InputError("salpchain evaluate needs a run folder or a policy, e.g. runs/eight")
    if options.suite:
        _run_suite(options)
        return
    lengths = parse_lengths(options.lengths or LENGTHS)
    trials, seed = positive("trials", options.trials or TRIALS), number("seed", options.seed)
    check_seed(seed)
    one_of("time limit", options.time_limit, TIME_LIMITS)
    check_there(options.policy)
    world, task = changed(world_config(options.world), options.task, options.set)
    from salpchain.devices import use_devices

    use_devices()  # before JAX starts, which reading a policy does
    tested = load(options.policy)
    if task is None:
        world, task = changed(world, tested.card.task_name, options.set, tested.card.trained_for)
    for length in lengths:
        tested.card.check_serves(length)
    out = Path(options.out) if options.out else default_out(options.policy)
    from salpchain.cli.display import share_display
    from salpchain.evaluation import impossible
    from salpchain.evaluation.evaluate import evaluate

    say(impossible.of_water(world, lengths))
    with share_display("testing", _programs(tested, lengths)) as watch:
        summary = evaluate(
            tested, lengths, trials, options.time_limit, seed, out,
            progress=watch, overwrite=options.overwrite, world=world, task=task,
        )  # fmt: skip
    say_if_trained_elsewhere(tested, world)
    _print(summary, out, options.json)


def _run_suite(options: Evaluate) -> None:
    """Plays all cells of a suite, writes its page and prints its verdict."""
    meant = suite(options.suite)
    given = {"world": options.world != "still", "task": options.task, "set": options.set}
    for name in (name for name, value in given.items() if value):
        raise InputError(f"--suite {meant.name} has worlds of its own: leave --{name} out")
    lengths = parse_lengths(options.lengths) if options.lengths else list(meant.lengths)
    trials = positive("trials", options.trials) if options.trials else meant.trials
    seed = check_seed(number("seed", options.seed))
    one_of("time limit", options.time_limit, TIME_LIMITS)
    check_there(options.policy)
    from salpchain.devices import use_devices

    use_devices()
    tested = load(options.policy)
    for length in lengths:
        tested.card.check_serves(length)
    out = Path(options.out) if options.out else default_out(options.policy, meant.name)
    from salpchain.cli.display import share_display
    from salpchain.evaluation.suite import run_suite
    from salpchain.report.suite import suite_page, verdict

    with share_display("testing", programs("", lengths)) as watch:
        summary = run_suite(
            tested, meant.name, lengths, trials, options.time_limit, seed, out,
            progress=watch, overwrite=options.overwrite,
        )  # fmt: skip
    written = [out / "suite.json", out / "suite.csv", *suite_page(summary, out)]
    print(dumps(summary, indent=2, allow_nan=False) if options.json else verdict(summary["cells"]))
    (say if options.json else print)(f"wrote {', '.join(map(str, written))}")


def _programs(tested: "Controller", lengths: list[int]) -> int:
    """How many programs must be compiled, of the policy and a planner's baseline."""
    from salpchain.controllers.policy import Planner

    if isinstance(tested, Planner):
        return len(lengths) + programs("", lengths)
    return programs(tested.card.control.model, lengths)


def _print(summary: dict[str, Any], out: Path, as_json: bool) -> None:
    """The tables, or the summary as JSON, and where the files are."""
    from salpchain.cli.tables import difficulty_table, show, table
    from salpchain.evaluation import impossible

    said = f"wrote {out / 'evaluation.csv'} and {out / 'evaluation.json'}"
    note = impossible.of_summary(summary)
    if as_json:
        print(dumps(summary, indent=2, allow_nan=False))
        say(note)
        say(said)
        return
    tables = [table(summary), *([] if summary.get("measures") else [difficulty_table(summary)])]
    show(*tables)
    if note:
        print(note)
    print(said)


def default_out(policy: str, what: str = "evaluation") -> Path:
    """Where the files go when the user does not say."""
    from salpchain.controllers.storage import POLICY_FILE

    path = Path(policy)
    if is_name(policy) or (is_path(policy) and not path.exists()):
        return Path(f"{what}-{policy.rpartition(':')[2]}")
    run = path if path.is_dir() else path.parent if path.name == POLICY_FILE else None
    return run / what if run is not None else Path(f"{what}-{path.stem}")
