"""All that a user does, as a program, for tests of JAX's global switches: prints what was refused.

python -m tests.training.switched mesh|plain NEW_RUN [OLD_RUN ...]
"""

import sys
from pathlib import Path

import jax

import salpchain
from tests.training.small import small


def attempt(name, action):
    try:
        return action()
    except salpchain.InputError as error:
        print(f"{name}: {error}")
    return None


def main(kind, new, *old):
    if kind == "mesh":
        jax.config.update("jax_num_cpu_devices", 2)
        jax.set_mesh(jax.make_mesh((2,), ("x",), (jax.sharding.AxisType.Explicit,)))
    policy = salpchain.load("any-length")
    env = salpchain.SCLD(policy.card.task(length=4))
    state = jax.jit(env.reset)(jax.random.key(0))
    state = jax.jit(lambda state: env.step(state, policy.act(state)))(state)
    assert jax.numpy.isfinite(state.obs).all()
    salpchain.record(policy, [3])
    salpchain.train(small(2), new)
    (Path(new) / "summary.json").unlink()
    salpchain.resume(new)
    salpchain.save_policy(salpchain.load(new), Path(new) / "again.safetensors")
    for run in old:
        attempt("load", lambda run=run: salpchain.load(run))
        (Path(run) / "summary.json").unlink(missing_ok=True)
        attempt("resume", lambda run=run: salpchain.resume(run))


if __name__ == "__main__":
    main(*sys.argv[1:])
