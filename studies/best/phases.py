"""Where does `any-length` lose time against the best-known swims?

python -m studies.best.phases [LENGTHS]

Each swim from a fixed start is cut into four: until half of the mean distance of the units to their
target points is closed, until nine tenths are, until the farthest unit is within `LAST` of its
point, and until the goal. Printed are the mean control steps of each part, for starts where both
take the target.
"""

import sys

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
from jaxtyping import Array, Float

from salpchain.devices import use_devices
from salpchain.errors import InputError
from salpchain.evaluation.best import solutions
from salpchain.evaluation.best.play import Place, poses
from salpchain.evaluation.best.starts import LENGTHS, STARTS
from salpchain.physics.chain import step
from salpchain.physics.state import Chain
from studies import program
from studies.best.run import POLICY, swims_of

LAST = 0.1  # m: the last stretch (chosen; the goal is 5.13 cm)
PARTS = ("half the way", "to nine tenths", "to the last 10 cm", "to the goal")


@jax.jit
def distances(chains: Chain, targets: Array, thrusts: Array) -> Float[Array, "step kind swim"]:
    """Mean and largest distance (m) of the units to their points after each control step."""

    def advance(chains: Chain, push: Array) -> tuple[Chain, Array]:
        chains = jax.vmap(step)(chains, push)
        off = jnp.linalg.norm(chains.units.position - targets, axis=-1)
        there = jnp.where(chains.present, off, 0.0)
        return chains, jnp.stack([there.sum(axis=-1) / chains.present.sum(axis=-1), there.max(-1)])

    return jax.lax.scan(advance, chains, thrusts)[1]


def parts(places: list[Place], thrusts: list[np.ndarray]) -> Float[np.ndarray, "swim part"]:
    """Control steps of each part of each swim."""
    slots = places[0][0]
    room = np.zeros((max(len(one) for one in thrusts), len(places), slots), np.float32)
    for i, one in enumerate(thrusts):
        room[: len(one), i, : one.shape[1]] = one
    chains, targets = poses(places, slots)
    off = jnp.linalg.norm(chains.units.position - targets, axis=-1).mean(axis=-1)
    mean, farthest = np.moveaxis(np.asarray(distances(chains, targets, jnp.asarray(room))), 1, 0)
    ends = np.array([len(one) for one in thrusts])
    close = [mean <= 0.5 * np.asarray(off), mean <= 0.1 * np.asarray(off), farthest <= LAST]
    firsts = [np.minimum(_first(one), ends) for one in close]
    return np.diff([0 * ends, *np.maximum.accumulate(firsts), ends], axis=0).T


def _first(there: np.ndarray) -> np.ndarray:
    """The first control step after which it holds; beyond the last where it never does."""
    return np.where(there.any(axis=0), there.argmax(axis=0) + 1, len(there) + 1)


def rows(length: int) -> list[dict[str, object]]:
    """Mean control steps of the parts, of the policy and of the best-known swims."""
    known = solutions.load(length)
    places = [(length, number) for number in range(STARTS)]
    swims, taken = swims_of(POLICY, places, length)
    both = [i for i in range(STARTS) if taken[i] and i in known]
    of = {
        POLICY: [swims[i] for i in both],
        "best-known": [known[i].newtons for i in both],
    }
    told = []
    for who, thrusts in of.items():
        mean = parts([places[i] for i in both], thrusts).mean(axis=0).round(1)
        steps = dict(zip(PARTS, mean, strict=True))
        told.append({"units": length, "swims": len(both), "of": who, **steps, "all": mean.sum()})
    return told


def main() -> None:
    """Reads the words; prints the table."""
    lengths = " ".join(sys.argv[1:]) or ",".join(map(str, LENGTHS))
    chosen = [int(word) for word in lengths.split(",") if word.isdecimal()]
    if lengths != ",".join(map(str, chosen)) or not set(chosen) <= set(LENGTHS):
        raise InputError(f"LENGTHS must be among {','.join(map(str, LENGTHS))}, got {lengths}")
    use_devices(1)
    table = pd.DataFrame([row for length in chosen for row in rows(length)])
    print(table.to_string(index=False))


if __name__ == "__main__":
    program("best", main, __doc__)
