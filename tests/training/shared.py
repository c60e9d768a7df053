"""The same iteration on one device and on four: a program, for JAX counts its devices once.

A joint that closes pulls one way or the other by the last bit, so a long rollout parts by itself:
two steps from rest, in double precision, do not.
"""

import jax

jax.config.update("jax_num_cpu_devices", 4)
jax.config.update("jax_enable_x64", True)

import json  # noqa: E402

import numpy as np  # noqa: E402

from salpchain.devices import mesh_of  # noqa: E402
from salpchain.tasks.reach.task import SCLD  # noqa: E402
from salpchain.training.learner import compile_iterate, new_state, place  # noqa: E402
from tests.training.small import small  # noqa: E402


def weights_on(devices):
    config = small(iterations=1, envs=64, rollout=2)
    env, mesh = SCLD(config.task), mesh_of(devices)
    learner = place(new_state(config, env), mesh)
    before = jax.tree.map(np.array, jax.tree.leaves(learner.policy))
    step = compile_iterate(config, env, mesh, learner)
    learner, _ = step(learner)
    return before, jax.tree.map(np.array, jax.tree.leaves(learner.policy))


if __name__ == "__main__":
    before, alone = weights_on(1)
    _, shared = weights_on(4)

    def change(ones, others):
        squares = [((a - b) ** 2).sum() for a, b in zip(ones, others, strict=True)]
        return float(np.sum(squares) ** 0.5)

    print(json.dumps({"learned": change(before, alone), "apart": change(alone, shared)}))
