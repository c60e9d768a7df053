"""All that a user does, as a program, for tests of JAX's global switches: prints what was refused.

python -m tests.training.switched [mesh,][swim,][train] NEW_RUN [OLD_RUN ...]
"""

import sys
from pathlib import Path

import jax
import jax.numpy as jnp

import salpchain
from salpchain.tasks.renew import renew_done
from tests.training.small import small


def attempt(name, action):
    try:
        return action()
    except salpchain.InputError as error:
        print(f"{name}: {error}")
    return None


def swim(policy):
    """One chain, and a batch, compiled before it is batched or differentiated."""
    env = salpchain.SCLD(policy.card.task(length=4, contact=False))
    state = jax.jit(env.reset)(jax.random.key(0))
    state = jax.jit(lambda state: env.step(state, policy.act(state)))(state)
    assert jnp.isfinite(state.obs).all()
    step = jax.jit(env.step)
    states = jax.vmap(jax.jit(env.reset))(jax.random.split(jax.random.key(0), 4))
    assert jnp.isfinite(jax.vmap(step)(states, jnp.zeros((4, 4, 1))).obs).all()
    assert jnp.isfinite(jax.grad(lambda action: step(state, action).reward)(jnp.ones((4, 1)))).all()


def swim_sharded(policy):
    """A batch that is sharded explicitly: it is stepped, and `act` says what to do."""
    env = salpchain.SCLD(policy.card.task(length=4))
    over_both = jax.NamedSharding(jax.sharding.get_mesh(), jax.P("x"))
    keys = jax.device_put(jax.random.split(jax.random.key(0), 4), over_both)
    states = jax.device_put(jax.jit(jax.vmap(env.reset))(keys), over_both)
    actions = jax.device_put(jnp.ones((4, 4, 1)), over_both)
    after = jax.jit(lambda *both: renew_done(env, jax.vmap(env.step)(*both)))(states, actions)
    assert jnp.isfinite(after.obs).all() and after.obs.sharding.spec[0] == "x"
    attempt("act", lambda: jax.vmap(policy.act)(states))


def train(new):
    """A run, gone on with when it has ended, and its policy read and written."""
    salpchain.train(small(2), new)
    (Path(new) / "summary.json").unlink()
    salpchain.resume(new)
    salpchain.save_policy(salpchain.load(new), Path(new) / "again.safetensors")


def main(deeds, new, *old):
    if "mesh" in deeds:
        jax.config.update("jax_num_cpu_devices", 2)
        jax.set_mesh(jax.make_mesh((2,), ("x",), (jax.sharding.AxisType.Explicit,)))
    policy = salpchain.load("any-length")
    if "swim" in deeds:
        swim(policy)
        salpchain.record(policy, [3])
    if "mesh" in deeds:
        swim_sharded(policy)
    if "train" in deeds:
        train(new)
    for run in old:
        attempt("load", lambda run=run: salpchain.load(run))
        (Path(run) / "summary.json").unlink(missing_ok=True)
        attempt("resume", lambda run=run: salpchain.resume(run))


if __name__ == "__main__":
    main(*sys.argv[1:])
