"""One policy for chains of different dynamics: those of the paper, on the ground, in water."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import equinox as eqx

from salpchain.controllers.policy import Policy
from salpchain.controllers.storage import load, save_policy
from salpchain.evaluation.evaluate import evaluate
from salpchain.training.config import TrainConfig
from salpchain.training.loop import Learner, iterate, new_learner
from salpchain.training.settings import preset
from salpchain.world.config import KINDS, DynamicsConfig, WorldConfig

NAME = "any-body"
RUN = Path("runs") / NAME
STEPS = 5_000_000  # chain-steps in each of the dynamics (chosen)
LENGTHS, TRIALS = (2, 3, 4, 8, 16, 32), 100  # of its tests
SEED = 2002  # of the starts that judge (chosen)
TOLD_EVERY = 10  # iterations


def settings() -> dict[str, TrainConfig]:
    """A run for each kind of dynamics, on 2 to 8 units; they differ in these alone.

    Jets in water push one way, so a chain may have to swim away to come back: a long horizon.
    """
    weights = tuple(float(length) for length in range(2, 9))
    same = {"steps": STEPS, "name": NAME, "mix.weights": weights, "task.time_limit": "scaled"}
    same |= {"ppo.gamma": 0.997}
    made = {}
    for seed, kind in enumerate(KINDS):
        own = {"world.dynamics.kind": kind, "seed": seed}
        made[kind] = preset(length="2..8", settings={**same, **own})
    return made


def any_body() -> None:
    """Train one policy in all dynamics in turn, one iteration in each, and test it in each.

    Episodes of all dynamics in one batch would need every chain moved by every law at every step.
    """
    file = RUN / f"{NAME}.safetensors"
    if not file.exists():
        RUN.mkdir(parents=True, exist_ok=True)
        save_policy(trained(settings()), file, half=True)
    policy = load(file)
    for kind in KINDS:
        tell(policy, kind)


def trained(configs: Mapping[str, TrainConfig]) -> Policy:
    """The policy after all iterations of all runs, which share its weights and their optimiser."""
    learners = {kind: new_learner(config, devices=1) for kind, config in configs.items()}
    last = next(iter(learners.values()))
    for number in range(last.config.iterations):
        for kind, learner in learners.items():
            last, seen = iterate(with_weights_of(learner, last))
            learners[kind] = last
            if number % TOLD_EVERY == 0:
                told = {name: round(seen[name], 3) for name in sorted(seen) if name in SHOWN}
                print(f"{last.steps:,} steps in {kind}: {told}", flush=True)
    return last.policy


SHOWN = ("success", "episode_success", "closed_fraction", "value_loss", "entropy")


def with_weights_of(learner: Learner, other: Learner) -> Learner:
    """The learner with the weights of another and what its optimiser remembers of them."""

    def shared(state: object) -> tuple[object, object]:
        return state.policy, state.optimiser_state  # type: ignore[attr-defined]

    return replace(learner, _state=eqx.tree_at(shared, learner._state, shared(other._state)))


def tell(policy: Policy, kind: str) -> None:
    """Print how often a policy reaches its target in these dynamics, by length."""
    world = WorldConfig(dynamics=DynamicsConfig(kind=kind))
    out = RUN / f"{policy.card.name}-{kind}"
    found = evaluate(
        policy, LENGTHS, TRIALS, "scaled", SEED, out, baseline=False, world=world, overwrite=True
    )
    for row in found["lengths"]:
        success = {part: 100 * row["success"][part] for part in ("mean", "low", "high")}
        print(
            f"{policy.card.name}, {kind}, {row['length']:3} units:"
            f" {success['mean']:.0f} % [{success['low']:.0f}, {success['high']:.0f}]",
            flush=True,
        )
