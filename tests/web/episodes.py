"""Episodes that the swim page and Python play from the same starts, both with `any-water`."""

import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np

import salpchain
from salpchain.tasks.reach.task import SCLD
from salpchain.web import swim_page

POLICY = "any-water"


def episodes(length, count, seed=0):
    """So many starts: as `Tank.play` takes them, with weights and limit, and as states."""
    policy = salpchain.load(POLICY)
    env = SCLD(policy.card.task(length))
    states = jax.jit(jax.vmap(env.reset))(jr.split(jr.key(seed), count))
    chain = states.chain.units
    units = np.concatenate([chain.position, chain.angle[..., None]], axis=-1).astype(float)
    targets = np.asarray(states.target, float)
    starts = [
        {"units": u, "target": t} for u, t in zip(units.tolist(), targets.tolist(), strict=True)
    ]
    limit = env.config.step_limit
    return {"file": swim_page.weights(policy), "limit": limit, "starts": starts}, states


def python_plays(length, states):
    """Which episodes Python takes to their goal."""
    policy = salpchain.load(POLICY)
    env = SCLD(policy.card.task(length))

    @jax.jit
    def play(states):
        def advance(_, carry):
            states, done = carry
            states = jax.vmap(lambda s: env.step(s, policy.act(s)))(states)
            return states, done | states.goal

        none = jnp.zeros(states.time.shape, bool)
        return jax.lax.fori_loop(0, env.config.step_limit, advance, (states, none))[1]

    return np.asarray(play(states))
