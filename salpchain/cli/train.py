"""`salpchain train`."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from salpchain.cli.options import (
    Flag,
    Folder,
    Lengths,
    Name,
    Task,
    Whole,
    World,
    decimals,
    text_option,
    whole,
)
from salpchain.cli.settings import File, Sets, check_agrees, combined
from salpchain.cli.streams import say
from salpchain.controllers.named import is_name
from salpchain.errors import InputError
from salpchain.evaluation.config import lengths_as_text, list_lengths, parse_lengths
from salpchain.networks.config import SINGLE_LENGTH
from salpchain.training import run_folder
from salpchain.training.config import TrainConfig
from salpchain.training.settings import compose, typed

# The setting of each option
PATHS = {
    "preset": "preset",
    "name": "name",
    "model": "control.model",
    "graph": "control.graph",
    "observation": "task.observation",
    "world": "world.name",
    "task": "task.name",
    "seed": "seed",
    "steps": "steps",
    "weights": "mix.weights",
    "curriculum": "mix.grow",
}


@dataclass(frozen=True)
class Train:
    """Train one controller with PPO, on chains of one length or of many lengths at once.

    The run folder gets config.json (every setting), metrics.csv and TensorBoard scalars, a
    checkpoint, policy.safetensors, and from the evaluation that closes the run evaluations.csv and
    summary.json. Stopped or killed, a run goes on with --resume, bit for bit as if it had never
    stopped. On several lengths, quick also asks for a goal of 2 cm,
    starts some episodes folded, shows each unit who is near, has gcn count a unit's own features
    twice, and takes twice the steps.

    Example: salpchain train --length 8 --preset quick --seed 0 --out runs/eight

    Example: salpchain train --length 4..16 --curriculum 0.9 --out runs/many

    Example: salpchain train --set ppo.learning_rate=1e-3 --set ppo.envs=512 --out runs/fast
    """

    out: Folder = ""
    """Folder of the run; must be new or empty, or a run to --resume. Required."""
    name: Name = ""
    """What the policy is called in tables and figures. Default: by model, graph and lengths, such
    as gcn-mixed-8."""
    preset: Name = ""
    """quick (ours: 95 % success in minutes; default) or paper (the paper's Table 2)."""
    model: Name = ""
    """Controller: gcn (default), gatv2 or gt (any length), or mlp (its training length only)."""
    graph: Name = ""
    """Who listens to whom: mixed (itself and its neighbours; default), full (everyone), near (up to
    4 links away) or hub (neighbours, and a summary of the chain)."""
    observation: Name = ""
    """body (a unit's own view; quick on one length), table1 (the paper's 24 numbers; paper),
    proximity (body and the nearest unit that is no neighbour; quick on several lengths), anonymous
    (proximity without the place in the chain), metric (proximity with what is far in metres),
    around (proximity, the water, the nearest surface, the own thruster), jets (proximity, and what
    the own thruster can do and did), sea (jets and the water) or one of your own, module:NAME. With
    *4 after it, as it is now and was in the three control steps before."""
    task: Task = ""
    """What it is to do: reach (the paper's: take a target pose; default), follow (a target that
    moves), dock, passage or gather (docs/tasks.md), or one of your own, module:Class."""
    world: World = ""
    length: Lengths = ""
    """Number of units, 2 to 1024 (default: 8), or several: each episode's is drawn anew."""
    weights: Annotated[str, text_option("X,X,...")] = ""
    """How often an episode has each of several lengths, which must ascend. Default: equally
    often."""
    curriculum: Annotated[str, text_option("SHARE")] = ""
    """Share of successes at which the next longer length joins. Default: all from the start."""
    seed: Whole = ""
    """Seed of all randomness. Default: 0."""
    steps: Whole = ""
    """Chain-steps in all, in whole rollouts. Default of quick: 1000000, and 31250 for each unit of
    the longest chain (gt on mixed: 500000 and 93750), twice that on several lengths; of paper:
    30720000."""
    config: File = ""
    """Settings from a file: a run's config.json, or a TOML with the same tables. They stand above
    the preset; --set and the options above stand above them."""
    set: Sets = ()
    """Any setting of config.json, such as ppo.learning_rate=1e-3; may be given several times.
    docs/settings.md lists them."""
    resume: Flag = False
    """Go on with the run in --out from its last checkpoint."""


def run(options: Train) -> int:
    """Trains, or goes on training; 130 when interrupted."""
    if not options.out:
        raise InputError("salpchain train needs --out FOLDER, the folder of the run")
    folder = Path(options.out)
    config = settings(options, folder)
    if not options.resume:
        run_folder.check_free(folder)
    elif run_folder.is_finished(folder):
        print(f"{folder} is trained already: all {config.total_steps:,} steps are done")
        _advise(folder)
        return 0
    from salpchain.cli.train_display import training_display
    from salpchain.evaluation import impossible
    from salpchain.training.metrics import NotFiniteError
    from salpchain.training.trainer import resume, train

    say(impossible.of_water(config.world, config.lengths))
    try:
        with training_display(config) as (iteration, stage):
            told = {"on_iteration": iteration, "on_stage": stage}
            summary = resume(folder, **told) if options.resume else train(config, folder, **told)
    except KeyboardInterrupt:
        say(f"stopped. Go on with: salpchain train --resume --out {folder}")
        return 130
    except NotFiniteError as error:
        print(f"salpchain: error: {error}", file=sys.stderr)
        return 1
    _report(summary, folder)
    return 0


def settings(options: Train, folder: Path) -> TrainConfig:
    """The settings of the run that the options ask for; of the run itself where it goes on.

    Raises:
        InputError: an invalid setting, or that contradicts the run's.
    """
    asked = _asked(options)
    if not options.resume:
        return _new(options, asked)
    config, _ = run_folder.read_config(folder)
    check_agrees(combined(options.config, options.set, {}), config, folder)
    has = _of_run(config)
    for name, (value, text) in has.items():
        if asked[name] not in (None, value):
            given = getattr(options, name)
            raise InputError(
                f"--resume goes on with the settings of {folder}, but --{name} is {text} in the"
                f" run, {given} was given: leave --{name} out"
            )
    return config


def _asked(options: Train) -> dict[str, Any]:
    """What was given, by option, None for what was left out.

    Raises:
        InputError: an option that cannot be read.
    """
    names = ("preset", "name", "model", "graph", "observation", "world", "task")
    return {
        **{name: getattr(options, name) or None for name in names},
        **{name: whole(name, getattr(options, name)) for name in ("seed", "steps")},
        "length": _lengths(options),
        "weights": decimals("weights", options.weights) or None,
        "curriculum": _share("curriculum", options.curriculum),
    }


def _lengths(options: Train) -> tuple[int, ...] | None:
    """The lengths given, ascending, each once; with weights they must be typed so."""
    if not options.length:
        return None
    lengths, typed = parse_lengths(options.length), list_lengths(options.length)
    if options.weights and lengths != typed:
        raise InputError(
            f"--weights needs lengths that ascend, each once, got {options.length}:"
            f" try --length {lengths_as_text(lengths)}"
        )
    return tuple(lengths)


def _share(name: str, text: str) -> float | None:
    """The one number that an option holds; None where it was left out."""
    given = decimals(name, text)
    if len(given) > 1:
        raise InputError(f"--{name} must be one number, such as 0.9, got {text!r}")
    if given and not 0 <= given[0] <= 1:
        raise InputError(f"--{name} must lie in [0, 1], got {text}")
    return given[0] if given else None


def _new(options: Train, asked: dict[str, Any]) -> TrainConfig:
    """The settings of a new run."""
    given = {path: (name, value) for name, (path, value) in _paths(asked).items()}
    values = combined(options.config, options.set, given)
    for name in ("weights", "curriculum"):
        if asked[name] is not None and len(values.get("mix.lengths", ())) < 2:
            got = options.length or "none"
            raise InputError(f"--{name} needs several lengths, got {got}: try --length 4..16")
    model = values.get("control.model")
    if model in SINGLE_LENGTH and "control.graph" in {*given, *typed(options.set)}:
        graph = values["control.graph"]
        raise InputError(f"an {model} has no graph, got {graph}: leave the graph out")
    return compose(values)


def _paths(asked: dict[str, Any]) -> dict[str, tuple[str, Any]]:
    """Path and value of each option that was given."""
    paths = {**PATHS, "length": "mix.lengths"}
    lengths = asked["length"] or ()
    if len(lengths) == 1:
        paths["length"], asked = "task.length", {**asked, "length": lengths[0]}
    return {name: (path, asked[name]) for name, path in paths.items() if asked[name] is not None}


def _of_run(config: TrainConfig) -> dict[str, tuple[Any, str]]:
    """What a run has of each option: as read, and as one would type it."""
    weights = config.mix.weights or (1.0,) * len(config.lengths)
    values = {
        "preset": config.preset,
        "name": config.policy_name,
        "model": config.control.model,
        "graph": config.control.graph,
        "observation": config.task.observation,
        "world": config.world.name,
        "task": config.task.name,
        "seed": config.seed,
        "steps": config.steps,
    }
    return {
        **{name: (value, str(value)) for name, value in values.items()},
        "length": (config.lengths, lengths_as_text(config.lengths)),
        "weights": (weights, ",".join(f"{weight:g}" for weight in weights)),
        "curriculum": (config.mix.grow, f"{config.mix.grow:g}"),
    }


def _report(summary: dict[str, Any], folder: Path) -> None:
    own = summary["evaluation"]
    mean, low, high = (100 * own["success"][name] for name in ("mean", "low", "high"))
    print(f"trained {summary['steps']:,} steps in {summary['seconds']:.0f} s")
    print(
        f"success {mean:.1f} % [{low:.0f}, {high:.0f}] of {own['trials']} episodes at"
        f" {lengths_as_text([row['length'] for row in own['lengths']])} units"
        " (deterministic, 95 % interval)"
    )
    _advise(folder)


def _advise(folder: Path) -> None:
    policy = f"./{folder}" if is_name(str(folder)) else folder
    say(f"test it on other lengths with: salpchain evaluate {policy}")
