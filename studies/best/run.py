"""Looks for swims with fewer steps from the fixed starts, and goes on from what is known.

python -m studies.best.run [LENGTHS] [ROUNDS] [FOLDER]

LENGTHS are units such as 2,3,4 (default: all); each round improves each length a little, and what
is found is written after it, so that it may be stopped at any time: the same command goes on.
FOLDER holds the solutions (default: those that come with the package). Begin it with `nice -n 10`.

A length of which nothing is known begins with the swims of any-length, and starts that it misses
with those of other policies. After that, each attempt takes the thrusts that are known, or those of
some policy, squeezes them into fewer steps, shakes them, and brings the units to their target
points at the last step (`descent.sooner`). Every start has a horizon of its own, which gets shorter
after a success and nearer to what is known after a failure, and never below what physics allows
(`turning.fewest_steps_turning`).
"""

import sys
import time
from functools import partial
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from salpchain.controllers.identity import identity
from salpchain.controllers.named import controller
from salpchain.devices import use_devices
from salpchain.errors import InputError
from salpchain.evaluation import episodes
from salpchain.evaluation.best import solutions, starts
from salpchain.evaluation.best.play import MARGIN, SLOTS, Place, holds, poses, replay
from salpchain.evaluation.best.solutions import QUANTA, Found, Solution, quantised
from salpchain.evaluation.best.starts import LENGTHS, STARTS
from salpchain.evaluation.best.table import bounds, refers_to, save_reference
from salpchain.physics.state import Chain
from salpchain.tasks.config import GOAL_LIMIT, step_limit
from salpchain.tasks.reach.task import SCLD
from salpchain.tasks.state import State
from studies import program
from studies.best.descent import problem, sooner

POLICY = "any-length"
WHO = "salpchain"
HOW = "Gauss-Newton steps through the engine, from swims of policies"
GUIDES = ("any-length", "any-length-1", "any-water", "paper-gt-16", "paper-gcn-16")
OTHER = 0.5  # share of attempts that begin with the swim of a guide (chosen)
NEARER = 0.043  # m, goal of swims that miss the task's when they are replayed (chosen)
LOOKS, BETWEEN = 3, 4  # at what an attempt has found, and steps between two (chosen)
TRUST = 0.3  # N, by which the first step changes thrusts at most (chosen)
SHORTER = (0.01, 0.08)  # least and first share of the steps to be saved (chosen)
NOISE = (0.0, 0.0, 0.1, 0.3)  # N, of which an attempt takes one (chosen)
ROOM = 16  # control steps by which the room for thrusts grows (chosen)
GROUPS = ((2, 3, 4), (6, 8), (12, 16), (32,))  # lengths that share a compiled program (chosen)
AT_ONCE = 4  # rounds before the next group (chosen)


class Swim(eqx.Module):
    """An episode and the thrusts so far."""

    state: State
    thrusts: Float[Array, "step unit"]


def follow(swim: Swim, state: State) -> Swim:
    """The swim after a control step."""
    return Swim(state, swim.thrusts.at[state.time - 1].set(state.thrust))


@eqx.filter_jit
def steered(policy: Any, env: SCLD, chains: Chain, targets: Array) -> Swim:
    """The swims of a policy from many starts."""
    keys = jax.random.split(jax.random.key(0), len(targets))
    states = jax.vmap(env.start)(chains, targets, keys)
    limit = env.config.step_limit
    thrusts = jnp.zeros((len(targets), limit, env.config.length))
    one = partial(episodes.alone, env, policy, follow)
    memory = jnp.zeros(len(targets))
    return episodes.play(one, Swim(states, thrusts), memory, jnp.int32(limit))[0]


def swims_of(
    name: str, places: list[Place], slots: int, tolerance: float = GOAL_LIMIT
) -> tuple[list[np.ndarray], np.ndarray]:
    """The thrusts (N) of a policy from some starts, (step, unit), and the steps that it takes (0
    where it fails) until all units are within the tolerance (m)."""
    policy = controller(name)
    task = policy.card.task(slots, tolerance=tolerance, most_steps=step_limit("scaled", slots))
    end = steered(policy, SCLD(task), *poses(places, slots))
    goal, times, thrusts = map(np.asarray, (end.state.goal, end.state.time, end.thrusts))
    swims = [
        one[: max(taken, 1), :length]
        for one, taken, (length, _) in zip(thrusts, times, places, strict=True)
    ]
    return swims, np.where(goal, times, 0)


def begin(
    name: str, places: list[Place], slots: int, tolerance: float
) -> tuple[dict[int, Found], dict[int, list[int]]]:
    """What a policy does from some starts: its solutions by length, and the steps that it takes."""
    swims, taken = swims_of(name, places, slots, tolerance)
    found: dict[int, Found] = {length: {} for length, _ in places}
    take(found, places, swims, f"the swim of {name}")
    steps: dict[int, list[int]] = {length: [] for length in found}
    for (length, _), count in zip(places, taken, strict=True):
        steps[length].append(int(count))
    return found, steps


def begin_all(lengths: list[int], folder: Path) -> None:
    """Begins where nothing is known; swims that, rounded, miss by a hair go on to a nearer goal.

    Where any-length is another than the one whose steps are kept, its swims are looked at anew.
    """
    policy = identity(controller(POLICY))
    for slots in SLOTS:
        own = [n for n in lengths if n <= slots and (slots == SLOTS[0] or n > SLOTS[0])]
        fresh = [n for n in own if not refers_to(n, policy, folder)]
        if fresh:
            every = [(n, start) for n in fresh for start in range(STARTS)]
            found, steps = begin(POLICY, every, slots, GOAL_LIMIT)
            for n in fresh:
                save_reference(n, steps[n], policy, folder)
                solutions.keep(n, found[n], folder)
        for name in GUIDES:
            known = {n: solutions.load(n, folder) for n in own}
            missing = [(n, start) for n in own for start in range(STARTS) if start not in known[n]]
            if missing:
                found, _ = begin(name, missing, slots, NEARER)
                for n in found:
                    solutions.keep(n, found[n], folder)


def take(
    found: dict[int, Found], places: list[Place], thrusts: list[np.ndarray], how: str
) -> np.ndarray:
    """Adds swims that are better than what is found, and hold; returns which were."""
    exact = [quantised(one) for one in thrusts]
    pushes = [one.astype(np.float32) / QUANTA for one in exact]
    steps = replay(places, pushes, GOAL_LIMIT - MARGIN).steps
    known = [found[length].get(number) for length, number in places]
    better = np.array(
        [
            end > 0 and (one is None or end < one.steps)
            for end, one in zip(steps, known, strict=True)
        ]
    )
    if better.any():
        better &= holds(
            places, [one[: max(end, 1)] for one, end in zip(pushes, steps, strict=True)]
        )
    for i in np.flatnonzero(better):
        length, number = places[i]
        found[length][number] = Solution(exact[i][: steps[i]], WHO, how)
    return better


def squeezed(thrusts: np.ndarray, steps: int) -> np.ndarray:
    """The thrusts in fewer control steps."""
    at = np.linspace(0, len(thrusts) - 1, steps)
    low = np.floor(at).astype(int)
    part = (at - low)[:, None]
    return (1 - part) * thrusts[low] + part * thrusts[np.minimum(low + 1, len(thrusts) - 1)]


def shaken(thrusts: np.ndarray, size: float, random: np.random.Generator) -> np.ndarray:
    """The thrusts with noise that is piecewise linear in time, knots 4 steps apart."""
    knots = size * random.normal(size=(len(thrusts) // 4 + 2, thrusts.shape[1]))
    return np.clip(thrusts + squeezed(knots, len(thrusts)), -1.0, 1.0)


def attempt(
    found: dict[int, Found],
    places: list[Place],
    least: np.ndarray,
    shares: np.ndarray,
    guides: list[list[np.ndarray]],
) -> np.ndarray:
    """One attempt at all of these starts, from what is known or a guide does; which got better."""
    random, slots = np.random.default_rng(), max(length for length, _ in places)
    known = [found[length][number] for length, number in places]
    steps = np.array([one.steps for one in known])
    room = int(-(-np.quantile(steps, 0.95) // ROOM) * ROOM)
    horizons = np.minimum(np.floor(steps * (1 - shares)), np.minimum(steps - 1, room))
    horizons = np.maximum(horizons, np.minimum(least, room)).astype(int)
    thrusts = np.zeros((room, slots, len(places)), np.float32)
    for i, (one, end) in enumerate(zip(known, horizons, strict=True)):
        from_guide = guides and random.random() < OTHER
        begun = guides[random.integers(len(guides))][i] if from_guide else one.newtons
        guess = shaken(squeezed(begun, end), random.choice(NOISE), random)
        thrusts[:end, : guess.shape[1], i] = guess
    task = problem(*poses(places, slots), horizons)
    pushes, trust = jnp.asarray(thrusts), jnp.full(len(places), TRUST)
    better = np.zeros(len(places), bool)
    for _ in range(LOOKS):
        for _ in range(BETWEEN):
            pushes, trust, _ = sooner(task, pushes, trust)
        every = zip(np.moveaxis(np.asarray(pushes), -1, 0), horizons, places, strict=True)
        swims = [one[:end, :length] for one, end, (length, _) in every]
        better |= take(found, places, swims, HOW)
    return better


def improve(group: tuple[int, ...], rounds: int, folder: Path) -> None:
    """Works at some lengths for some rounds and tells how far they are."""
    found = {length: solutions.load(length, folder) for length in group}
    places = [(length, number) for length in group for number in sorted(found[length])]
    least = np.array([bounds(length)[number] for length, number in places])
    shares = np.full(len(places), SHORTER[1])
    guides = [swims_of(name, places, max(group))[0] for name in GUIDES]
    for name, swims in zip(GUIDES, guides, strict=True):
        take(found, places, swims, f"the swim of {name}")
    for number in range(rounds):
        began = time.monotonic()
        better = attempt(found, places, least, shares, guides)
        shares = np.clip(np.where(better, shares, 0.7 * shares), *SHORTER)
        found = {length: solutions.keep(length, found[length], folder) for length in group}
        steps = np.array([found[length][start].steps for length, start in places])
        units = np.array([length for length, _ in places])
        ratios = [f"{np.median((least / steps)[units == length]):.3f}" for length in group]
        print(
            f"{group} units, round {number + 1}: {better.sum()} better, bound / best"
            f" {', '.join(ratios)}, {time.monotonic() - began:.0f} s",
            flush=True,
        )


def main() -> None:
    """Works through the lengths, some rounds each, as often as asked."""
    lengths, rounds, folder = [*sys.argv[1:], *("", "", "")][:3]
    chosen = [int(word) for word in lengths.split(",") if word.isdigit()] or list(LENGTHS)
    if (lengths and lengths != ",".join(map(str, chosen))) or not set(chosen) <= set(LENGTHS):
        raise InputError(f"LENGTHS must be among {','.join(map(str, LENGTHS))}, got {lengths}")
    if rounds and not rounds.isdigit():
        raise InputError(f"ROUNDS must be a whole number, 0 or more, got {rounds}")
    use_devices(1)
    out = Path(folder or starts.FOLDER)
    begin_all(chosen, out)
    for _ in range(int(rounds or 1)):
        for group in GROUPS:
            if some := tuple(n for n in group if n in chosen):
                improve(some, AT_ONCE, out)


if __name__ == "__main__":
    program("best", main, __doc__)
