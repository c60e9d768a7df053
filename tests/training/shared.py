"""The same iterations on one device and on four: a program, for JAX counts its devices once."""

import jax

jax.config.update("jax_num_cpu_devices", 4)

import json  # noqa: E402

import numpy as np  # noqa: E402

from salpchain.domain.scld import SCLD  # noqa: E402
from salpchain.training.devices import mesh_of  # noqa: E402
from salpchain.training.learner import compile_iterate, new_learner, place  # noqa: E402
from tests.training.small import small  # noqa: E402

ITERATIONS = 1


def weights_on(devices):
    config = small(ITERATIONS)
    env, mesh = SCLD(config.task), mesh_of(devices)
    learner = place(new_learner(config, env), mesh)
    before = jax.tree.map(np.array, jax.tree.leaves(learner.policy))
    step = compile_iterate(config, env, mesh, learner)
    for _ in range(ITERATIONS):
        learner, _ = step(learner)
    return before, jax.tree.map(np.array, jax.tree.leaves(learner.policy))


if __name__ == "__main__":
    before, alone = weights_on(1)
    _, shared = weights_on(4)

    def change(ones, others):
        squares = [((a - b) ** 2).sum() for a, b in zip(ones, others, strict=True)]
        return float(np.sum(squares) ** 0.5)

    print(json.dumps({"learned": change(before, alone), "apart": change(alone, shared)}))
