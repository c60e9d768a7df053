"""Speed of learning: whole training iterations, and graph layers beside a plain MLP.

python -m benchmarks.learning [--name NAME] [--overwrite]

Iterations of both presets as the trainer runs them, on all devices, compilation apart. Passes of
the graph models on `mixed` and of an MLP with as many multiplications, in turn, on one device; the
record goes to results/.
"""

import argparse
import json
import statistics
import time
from collections.abc import Callable, Iterator
from typing import Any

import jax
import jax.numpy as jnp
import jax.random as jr

from benchmarks.run import add_options, begun
from salpchain.devices import largest_divisor, mesh_of, use_devices
from salpchain.files import write_json
from salpchain.networks.actor_critic import GraphActorCritic, actor_critic
from salpchain.networks.config import ControlConfig
from salpchain.networks.layers import Head, Linear, head
from salpchain.tasks.features import observation_size
from salpchain.tasks.reach.task import SCLD
from salpchain.training.config import TrainConfig
from salpchain.training.learner import compile_iterate, new_state, place
from salpchain.training.presets import choose
from salpchain.xla import flat_products

ORIGINAL = 50.0  # chain-steps/s of the original study's trainer on such a machine (DESIGN)
GRAPH_MODELS = ("gcn", "gatv2", "gt")
SECONDS = 10.0  # at least, of iterations that are timed
UNITS, CHAINS, PAIRS = 16, 128, 30  # of a comparison
INPUTS, ACTIONS = observation_size("table1"), 2


def iterations(config: TrainConfig, devices: int) -> float:
    """Chain-steps per second of training with these settings."""
    env, mesh = SCLD(config.task, config.world), mesh_of(largest_divisor(config.ppo.envs, devices))
    learner = place(new_state(config, env), mesh)
    iterate = compile_iterate(config, env, mesh, learner)
    learner, _ = jax.block_until_ready(iterate(learner))
    begun, number = time.perf_counter(), 0
    while time.perf_counter() < begun + SECONDS:
        learner, _ = jax.block_until_ready(iterate(learner))
        number += 1
    return number * config.ppo.batch / (time.perf_counter() - begun)


def rows(devices: int) -> Iterator[tuple[str, dict[str, Any]]]:
    """Every comparison, as it is made."""
    yield from (("passes", beside_mlp(model)) for model in GRAPH_MODELS)
    yield from (("trainings", row) for row in trainings(devices))


def trainings(devices: int) -> Iterator[dict[str, Any]]:
    """Both presets, each graph model on `mixed` and the mlp, at both training lengths."""
    for preset in ("paper", "quick"):
        for length in (8, 16):
            for model in ("mlp", *GRAPH_MODELS):
                config = choose(preset, model=model, graph=_graph(model), length=length)
                rate = iterations(config, devices)
                row = {"preset": preset, "run": config.policy_name, "steps_per_second": rate}
                if preset == "paper":
                    row["ratio_to_original"] = rate / ORIGINAL
                yield row


def _graph(model: str) -> str | None:
    return None if model == "mlp" else "mixed"


def beside_mlp(model: str) -> dict[str, Any]:
    """Forward and backward pass of actor and critic at 16 units, and of an MLP of their size."""
    policy = actor_critic(jr.key(0), ControlConfig(model=model), INPUTS, ACTIONS, UNITS)
    multiplications = _multiplications(policy)
    both = INPUTS + ACTIONS  # width^2 + both x width is what such an MLP multiplies
    width = round((both**2 / 4 + multiplications) ** 0.5 - both / 2)
    plain = head(jr.key(1), [INPUTS, width, width, ACTIONS])
    obs = jr.normal(jr.key(2), (CHAINS, UNITS, INPUTS))
    present, joined = jnp.ones((CHAINS, UNITS), bool), jnp.ones((CHAINS, UNITS - 1), bool)

    @jax.jit
    @jax.grad
    def of_policy(policy: GraphActorCritic) -> jax.Array:
        with flat_products():
            action, value = jax.vmap(policy)(obs, present, joined)
        return (action**2).sum() + (value**2).sum()

    @jax.jit
    @jax.grad
    def of_plain(plain: Head) -> jax.Array:
        return (plain(obs) ** 2).sum()

    pairs = [(_seconds(of_policy, policy), _seconds(of_plain, plain)) for _ in range(PAIRS + 1)]
    ours, theirs = (statistics.median(times) for times in zip(*pairs[1:], strict=True))
    return {
        "model": model,
        "multiplications_per_unit": round(multiplications),
        "mlp_width": width,
        "milliseconds": 1e3 * ours,
        "mlp_milliseconds": 1e3 * theirs,
        "ratio": statistics.median(one / other for one, other in pairs[1:]),
    }


def _multiplications(policy: GraphActorCritic) -> float:
    """By the weights of linear maps, for each unit: the critic's head works once for a chain."""
    whole, critic = (
        sum(x.weight.size for x in jax.tree.leaves(part, is_leaf=_is_linear) if _is_linear(x))
        for part in (policy, policy.critic)
    )
    return whole - critic + critic / UNITS


def _is_linear(x: Any) -> bool:
    return isinstance(x, Linear)


def _seconds(work: Callable, *given: Any) -> float:
    begun = time.perf_counter()
    jax.block_until_ready(work(*given))
    return time.perf_counter() - begun


def main() -> None:
    """Runs all comparisons, prints and writes them."""
    parser = argparse.ArgumentParser(description=__doc__)
    add_options(parser)
    options = parser.parse_args()
    devices = use_devices()
    path, record = begun("learning", options)
    record |= {"devices": devices, "passes": [], "trainings": []}
    for kind, row in rows(devices):
        print(json.dumps(row), flush=True)
        record[kind].append(row)
        write_json(path, record)


if __name__ == "__main__":
    main()
