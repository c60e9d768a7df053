"""Breeds a policy for each start: from weights shaken at random, those that swim it in fewer steps.

python -m studies.best.evolve LENGTH ROUNDS [FOLDER] [POLICY]

Each of the 100 starts of LENGTH units has its own copy of POLICY (default: any-length). In a round
each copy's weights are shaken, the swims are played, and a copy that takes its target in fewer
steps, or in as many but nearer to it, takes the old one's place: an evolution strategy of one
parent and one child, whose shakes grow after a success and shrink after a failure (Rechenberg
1973, success rule). Thrusts are rounded as solutions are, so that a swim is what will be replayed,
and must lead to the target from a start moved by ten micrometres too (`play.holds`). Every
`BETWEEN` rounds what is better than what is known is written into FOLDER (default: the solutions
that come with the package), so that it may be stopped at any time; begun anew, it breeds anew.

For long chains: there the engine's gradients lead nowhere (joints chatter, units touch), and a
policy goes on correcting what has been changed before.
"""

import sys
import time
from functools import partial
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray

from salpchain.controllers.named import controller
from salpchain.controllers.policy import Policy, act
from salpchain.devices import use_devices
from salpchain.errors import InputError
from salpchain.evaluation import episodes
from salpchain.evaluation.best import solutions, starts
from salpchain.evaluation.best.play import MARGIN, WOBBLE, nudged, play, poses
from salpchain.evaluation.best.solutions import QUANTA
from salpchain.evaluation.best.starts import LENGTHS, STARTS
from salpchain.files import make_writable
from salpchain.physics.state import Chain
from salpchain.tasks.config import GOAL_LIMIT, step_limit
from salpchain.tasks.reach.task import SCLD
from salpchain.tasks.state import State
from studies import program
from studies.best.run import Swim, follow, take

HOW = "the swim of {}, its weights bred for this start"
FIRST = 0.1  # shake, as a share of the root mean square of an array of weights (chosen)
LARGER, SMALLER = 1.3, 0.97  # what the shake is multiplied with: one success in ten keeps it
LEAST, MOST = 0.02, 0.5  # shake (chosen)
BETWEEN = 10  # rounds before what is found is kept (chosen)


class Parents(eqx.Module):
    """The best so far of each start."""

    weights: Any  # of the policy, an array's first axis the start
    steps: Int[Array, " start"]  # control steps until the goal; one above the limit: it misses
    apart: Float[Array, " start"]  # m, largest distance of a unit from its point then
    shake: Float[Array, " start"]
    thrusts: Float[Array, "start step unit"]  # N


@eqx.filter_jit
def bred(
    policy: Any, env: SCLD, chains: Chain, targets: Array, parents: Parents, key: PRNGKeyArray
) -> Parents:
    """The parents of the next round."""
    weights_key, start_key, moves_key = jr.split(key, 3)
    weights = mutated(parents.weights, parents.shake, weights_key)
    states = jax.vmap(env.start)(chains, targets, jr.split(start_key, len(targets)))
    first = Swim(states, jnp.zeros_like(parents.thrusts))
    until = jnp.minimum(parents.steps.max(), env.config.step_limit)
    end, _ = episodes.play(partial(_step, policy, env), first, weights, until)
    steps = jnp.where(end.state.goal, end.state.time, env.config.step_limit + 1)
    apart = jax.vmap(_apart)(end.state)
    sooner = steps < parents.steps
    better = sooner | ((steps == parents.steps) & (apart < parents.apart))
    moved = nudged(chains, WOBBLE, moves_key)
    better &= play(GOAL_LIMIT, moved, targets, end.thrusts, steps)[0] > 0
    shake = jnp.clip(parents.shake * jnp.where(better, LARGER, SMALLER), LEAST, MOST)
    child = Parents(weights, steps, apart, shake, end.thrusts)

    def chosen(new: Array, old: Array) -> Array:
        return jnp.where(better.reshape(-1, *[1] * (new.ndim - 1)), new, old)

    kept: Parents = jax.tree.map(chosen, child, parents)
    return eqx.tree_at(lambda one: one.shake, kept, shake)


def mutated(weights: Any, shake: Float[Array, " start"], key: PRNGKeyArray) -> Any:
    """The weights of each start with noise, in proportion to the size of their array's."""
    arrays, tree = jax.tree.flatten(weights)
    noisy = []
    for one, own in zip(arrays, jr.split(key, len(arrays)), strict=True):
        size = shake * jnp.sqrt(jnp.mean(one**2, axis=tuple(range(1, one.ndim))))
        noise = jr.normal(own, one.shape)
        noisy.append(one + size.reshape(-1, *[1] * (one.ndim - 1)) * noise)
    return jax.tree.unflatten(tree, noisy)


def _step(policy: Any, env: SCLD, swim: Swim, weights: Any) -> tuple[Swim, Any]:
    """A control step of one start, thrusts rounded."""
    action, _ = act(eqx.combine(weights, policy), swim.state, None)
    rounded = jnp.round(jnp.clip(action, -1.0, 1.0) * QUANTA) / QUANTA
    return follow(swim, env.step(swim.state, rounded)), weights


def _apart(state: State) -> Float[Array, ""]:
    off = jnp.linalg.norm(state.chain.units.position - state.target, axis=-1)
    return jnp.where(state.chain.present, off, 0.0).max()


def begun(policy: Policy, count: int, limit: int, length: int) -> tuple[Parents, Any]:
    """Parents for a first round, which swims as the policy does; and what of it is no weight."""
    arrays, rest = eqx.partition(policy, eqx.is_inexact_array)
    parents = Parents(
        jax.tree.map(lambda x: jnp.broadcast_to(x, (count, *x.shape)), arrays),
        jnp.full(count, limit + 1),
        jnp.full(count, jnp.inf),
        jnp.zeros(count),
        jnp.zeros((count, limit, length)),
    )
    return parents, rest


def evolve(length: int, rounds: int, folder: Path, name: str) -> None:
    """Breeds for some rounds, keeps what is found, and tells how far it is."""
    policy = controller(name)
    if not isinstance(policy, Policy) or policy.card.action != "thrust":
        raise InputError(f"POLICY must be learned and tell each unit its thrust, {name} is not so")
    policy.card.check_serves(length)
    make_writable(folder)
    limit = step_limit("scaled", length)
    task = policy.card.task(length, tolerance=GOAL_LIMIT - MARGIN, most_steps=limit)
    places = [(length, number) for number in range(STARTS)]
    (chains, targets), env = poses(places, length), SCLD(task)
    parents, rest = begun(policy, STARTS, limit, length)
    began, words = time.monotonic(), HOW.format(name)
    for number in range(rounds + 1):
        key = jr.fold_in(jr.key(time.time_ns() % 2**31), number)
        parents = bred(rest, env, chains, targets, parents, key)
        if number == 0:
            parents = eqx.tree_at(lambda one: one.shake, parents, jnp.full(STARTS, FIRST))
        if number % BETWEEN == 0 or number == rounds:
            told = _kept(length, parents, places, folder, words)
            took = time.monotonic() - began
            print(f"{length} units, round {number}: {told}, {took:.0f} s", flush=True)


def _kept(
    length: int, parents: Parents, places: list[tuple[int, int]], folder: Path, how: str
) -> str:
    """Takes what is better than what is known; says what."""
    found = solutions.load(length, folder)
    steps, thrusts = np.asarray(parents.steps), np.asarray(parents.thrusts)
    swims = [one[: min(own, len(one))] for one, own in zip(thrusts, steps, strict=True)]
    better = take({length: found}, places, swims, how)
    found = solutions.keep(length, found, folder)
    known = [one.steps for one in found.values()]
    return (
        f"{better.sum()} better, median {np.median(steps)} steps, of all known {np.median(known)}"
        f" ({len(known)} starts), shake {np.median(np.asarray(parents.shake)):.2f}"
    )


def main() -> None:
    """Reads the words; breeds."""
    length, rounds, folder, name = [*sys.argv[1:], *[""] * 4][:4]
    if length not in map(str, LENGTHS):
        raise InputError(f"LENGTH must be one of {', '.join(map(str, LENGTHS))}, got {length}")
    if not rounds.isdecimal() or not rounds.isascii():
        raise InputError(f"ROUNDS must be a whole number, 0 or more, got {rounds}")
    use_devices(1)
    evolve(int(length), int(rounds), Path(folder or starts.FOLDER), name or "any-length")


if __name__ == "__main__":
    program("best", main, __doc__)
