"""Can a chain with half of its thrusters dead take the targets that any-water misses?

python -m studies.best.dead [UNITS] [TRIALS] [STEPS] [ROUNDS]

Plays the policy in the cell `dead`, grade `hard`, of the suite `sea` (8 units, 200 trials),
takes up to `SWIMS` trials that it missed, and looks for thrusts that bring all units near their
target points at control step STEPS (256), from what the policy did, by ROUNDS (24) Gauss-Newton
steps through the engine (`descent.sooner`, contact left out). The thrusts are then replayed in the
task itself, contact counted. What is found there says that it can be done; what is not found says
nothing.
"""

import sys
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from salpchain.controllers.named import controller
from salpchain.devices import use_devices
from salpchain.errors import InputError
from salpchain.evaluation.starts import domain_for, start_keys
from salpchain.evaluation.suites import suite
from salpchain.evaluation.trials import run_trials
from salpchain.tasks.config import GOAL_LIMIT
from salpchain.tasks.state import State
from salpchain.tasks.task import Task
from studies import program
from studies.best.descent import ends, problem, sooner

POLICY, SEED, LIMIT = "any-water", 2001, "scaled"
SWIMS = 32  # at once (chosen)
TRUST = 0.3  # N, by which the first step changes thrusts at most (chosen)
DEFAULTS = 8, 200, 256, 24  # units, trials, control steps, rounds
MOST = 4096  # of any of them


def played(units: int, trials: int) -> tuple[Task, Bool[np.ndarray, " trial"]]:
    """The task in that cell, and in which trials the policy takes its target."""
    cell = next(c for c in suite("sea").cells(units) if (c.trouble, c.grade) == ("dead", "hard"))
    (world,) = cell.worlds.values()
    policy = controller(POLICY)
    (frame,) = run_trials([policy], units, trials, LIMIT, SEED, world=world)
    env = domain_for([policy], units, LIMIT, world)
    success = frame["success"].to_numpy(bool)
    print(f"{POLICY} takes {success.sum()} of {trials} targets with half of {units} units dead")
    return env, success


def swum(env: Task, states: State, steps: int) -> Array:
    """The thrusts (N) of the policy, (step, unit, swim)."""
    policy: Any = controller(POLICY)

    def advance(states: State, _: None) -> tuple[State, Array]:
        states = jax.vmap(env.step)(states, jax.vmap(policy.act)(states))
        return states, states.thrust

    thrusts = jax.jit(lambda begun: jax.lax.scan(advance, begun, None, steps)[1])(states)
    return jnp.moveaxis(thrusts, 1, -1)


def replayed(env: Task, states: State, thrusts: Array) -> Bool[np.ndarray, " swim"]:
    """Which swims take their target in the task under these thrusts, (step, unit, swim)."""

    def advance(now: tuple[State, Array], thrust: Array) -> tuple[tuple[State, Array], None]:
        after = jax.vmap(env.step)(now[0], thrust.T[..., None])
        return (after, now[1] | after.goal), None

    never = jnp.zeros(thrusts.shape[-1], bool)
    end = jax.jit(lambda begun: jax.lax.scan(advance, (begun, never), thrusts)[0][1])
    return np.asarray(end(states))


def tell(what: str, rows: np.ndarray, which: Bool[np.ndarray, " swim"]) -> None:
    """Prints how many there are by how many units at an end are dead."""
    shares = [
        f"{row} dead {which[rows == row].sum()} of {(rows == row).sum()}" for row in np.unique(rows)
    ]
    print(f"{what}, by the units in a row that are dead at an end: {', '.join(shares)}")


def dead_ends(live: Bool[np.ndarray, " unit"]) -> int:
    """Dead units in a row at that end of the chain that has more of them."""
    pushing = np.flatnonzero(live)
    return int(max(pushing[0], len(live) - 1 - pushing[-1]))


def main() -> None:
    """Plays, looks, and tells what was found by how many units at an end are dead."""
    words = sys.argv[1:]
    if len(words) > len(DEFAULTS) or not all(w.isdigit() and 1 <= int(w) <= MOST for w in words):
        raise InputError(f"UNITS, TRIALS, STEPS and ROUNDS must be 1 to {MOST}, got {words}")
    units, trials, steps, rounds = (*map(int, words), *DEFAULTS[len(words) :])
    use_devices(1)
    env, success = played(units, trials)
    keys = start_keys(SEED, units, jnp.arange(trials))
    begun = jax.jit(jax.vmap(lambda key: env.reset(key, jnp.int32(units))))(keys)
    live = begun.world.thrusters.gain > 0
    rows = np.array([dead_ends(one[:units]) for one in np.asarray(live)])
    tell(f"taken by {POLICY}", rows, success)
    numbers = np.flatnonzero(~success)[:SWIMS]
    if not len(numbers):
        return
    states, live, rows = jax.tree.map(lambda x: x[numbers], (begun, live, rows))
    task = problem(states.chain, states.target, np.full(len(numbers), steps), live)
    thrusts, trust = swum(env, states, steps), jnp.full(len(numbers), TRUST)
    for number in range(rounds):
        thrusts, trust, _ = sooner(task, thrusts, trust)
        farthest = jnp.sqrt((ends(task, thrusts) ** 2).sum(axis=0)).max(axis=0)
        there = np.asarray(farthest) < GOAL_LIMIT
        print(f"round {number + 1}: {there.sum()} of {len(there)} there", flush=True)
    tell("taken by the thrusts found", rows, there)
    tell("and in the task itself", rows, replayed(env, states, thrusts))


if __name__ == "__main__":
    program("dead", main, __doc__)
