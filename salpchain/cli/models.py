"""`salpchain models`."""

from dataclasses import dataclass
from json import dumps
from typing import Annotated, Any

import tyro

from salpchain.checks import check_length
from salpchain.cli.options import Flag, Name, Whole, number, text_option
from salpchain.controllers.named import WRITTEN
from salpchain.controllers.released import model_card, released
from salpchain.errors import InputError
from salpchain.networks.config import MODELS
from salpchain.tasks.features import check_observation, observation_size


@dataclass(frozen=True)
class Models:
    """List the controllers with their parameter counts, and the policies that are released.

    The paper's count of a model belongs to training length 8, the observation table1, two actions
    for each unit and one log-std for each action; that is what is counted here. With the name of a
    released policy: its model card.

    Example: salpchain models --length 8
    """

    policy: tyro.conf.Positional[Annotated[str, text_option("NAME")]] = ""
    """A released policy whose model card to show."""
    length: Whole = ""
    """Training length, which sets the number of log-stds. Default: 8."""
    observation: Name = ""
    """What the units observe: table1 (the paper's; default), body, proximity (as any-length),
    anonymous, metric, around, jets, sea or one of your own, module:NAME; jets*4: of 4 steps."""
    json: Flag = False
    """Print all of it, model cards included, as JSON alone."""


def run(options: Models) -> None:
    """Prints a line for each model, the hand-written controllers and each released policy."""
    if options.policy:
        _check_alone(options)
        card = _card(options.policy)
        print(dumps(model_card(options.policy), indent=2) if options.json else card)
        return
    length = check_length(number("length", options.length or "8"))
    observation = options.observation or "table1"
    check_observation(observation)
    from salpchain.networks.actor_critic import num_parameters

    inputs = observation_size(observation)
    counts = {model: num_parameters(model, inputs, length) for model in MODELS}
    if options.json:
        print(_as_json(observation, length, counts))
        return
    print(f"{'model':<8} {'parameters':>10}   ({observation}, {length} units)")
    for model, count in counts.items():
        print(f"{model:<8} {count:>10,}")
    for name, written in WRITTEN.items():
        print(f"{name:<8} {0:>10,}   {written.about}; for any length")
    if released():
        print("\nreleased policies (salpchain models NAME shows the model card)")
    width = max([14, *map(len, released())])
    for name in released():
        print(f"{name:<{width}} {model_card(name)['about']}")


def _as_json(observation: str, length: int, counts: dict[str, int]) -> str:
    """All that the list says; of each released policy its model card."""
    content = {
        "observation": observation,
        "length": length,
        "models": [{"name": name, "parameters": count} for name, count in counts.items()],
        "written": [{"name": name, "about": one.about} for name, one in WRITTEN.items()],
        "released": [{"name": name, **model_card(name)} for name in released()],
    }
    return dumps(content, indent=2)


def _check_alone(options: Models) -> None:
    """Raise InputError if a model card is asked for with options of the list."""
    for name in ("length", "observation"):
        given = getattr(options, name)
        if given:
            raise InputError(
                f"--{name} is for the list of controllers, got {given} with {options.policy}:"
                f" leave --{name} or the name out"
            )


def _card(name: str) -> str:
    """The model card of a released policy as text."""
    if name not in released():
        known = ", ".join(released())
        advice = f"choose one of {known}" if known else "none is released yet"
        raise InputError(f"no released policy {name!r}: {advice}")
    card = model_card(name)
    lines = [f"{name}: {card['about']}", f"made by: {card['command']}"]
    lengths = ", ".join(map(str, card["training_lengths"]))
    lines.append(f"trained on: {lengths} units, {card['steps']:,} steps, {card['minutes']} minutes")
    lines += [f"limits: {card['limits']}", f"licence: {card['licence']}"]
    limit, seed = card["time_limit"], card["seed"]
    lines.append(
        f"measured: {card['trials']} episodes of each length, time limit {limit}, seed {seed}"
    )
    columns = f"{'success % [95 %]':>20} {'closed %':>9} {'steps to goal':>14}"
    lines.append(f"{'units':>7} {columns}")
    for row in card["measured"]:
        success, closed = 100 * row["success"], 100 * row["closed_fraction"]
        steps = "-" if row["steps_to_goal"] is None else f"{row['steps_to_goal']:g}"
        low, high = (100 * bound for bound in row["interval"])
        share = f"{success:.1f} [{low:.0f}, {high:.0f}]"
        lines.append(f"{row['length']:>7} {share:>20} {closed:>9.1f} {steps:>14}")
    if "suite" in card:
        lines += _suite(card["suite"])
    return "\n".join(lines)


def _suite(suite: dict[str, Any]) -> list[str]:
    """Success in each cell of a suite: a line for each trouble and grade."""
    lengths = suite["lengths"]
    lines = [
        f"suite {suite['suite']}, version {suite['version']}: success % of {suite['trials']}"
        f" episodes in each cell, seed {suite['seed']}",
        f"{'units':>18} " + " ".join(f"{length:>4}" for length in lengths),
    ]
    found = {(c["trouble"], c["grade"], c["length"]): c["success"] for c in suite["cells"]}
    for trouble, grade in dict.fromkeys((trouble, grade) for trouble, grade, _ in found):
        row = " ".join(f"{100 * found[trouble, grade, length]:>4.0f}" for length in lengths)
        lines.append(f"{trouble + ('' if grade == 'none' else ' ' + grade):>18} {row}")
    return lines
