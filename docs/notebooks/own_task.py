"""Your own task, as a marimo notebook: `marimo edit docs/notebooks/own_task.py`."""

import marimo

app = marimo.App(app_title="salpchain: your own task")


@app.cell
def _():
    import jax
    import jax.numpy as jnp
    import marimo as mo

    import salpchain

    return jax, jnp, mo, salpchain


@app.cell
def _(mo):
    mo.md("""
    # Your own task

    What a chain is asked to do is a class: how an episode begins, what a step is worth, what is
    measured. All else (training, evaluation, pictures, bridges, worlds) takes it as it is.
    This one asks a chain to stay where it is, whatever the water does.
    """)
    return


@app.cell
def _(jnp, salpchain):
    class Hover(salpchain.Task):
        """Stay where you are, whatever the water does."""

        weights = {"near": 1.0}  # of the terms of the reward, logged by these names

        def begin(self, key, draw_key, length, physics):
            chain = self.spawn(draw_key, length, physics)
            return salpchain.Start(chain, target=chain.units.position)

        def judge(self, before, after):
            near = jnp.exp(-after.distances.mean / 0.05)
            return salpchain.Judgement({"near": near}, ended=jnp.zeros((), bool))

    return (Hover,)


@app.cell
def _(mo):
    speed = mo.ui.slider(0, 8, value=4, label="speed of the water (cm/s)")
    speed
    return (speed,)


@app.cell
def _(Hover, jax, salpchain, speed):
    water = salpchain.Range(speed.value / 100, speed.value / 100)
    world = salpchain.WorldConfig(current=salpchain.CurrentConfig(speed=water))
    policy = salpchain.load("any-length")
    env = Hover(policy.card.task(6), world)
    states = jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.key(0), 16))
    held = jax.jit(lambda states: jax.vmap(env.step)(states, jax.vmap(policy.act)(states)))
    for _ in range(100):  # 10 s
        states = held(states)
    drift = 100 * float(states.distances.mean.mean())
    return drift, policy


@app.cell
def _(drift, mo, policy, speed):
    mo.md(
        f"In water of {speed.value} cm/s 16 chains of 6 units drift by **{drift:.1f} cm** in 10 s"
        f" with `{policy.card.name}`, which was trained to reach poses in still water."
    )
    return


@app.cell
def _(mo):
    mo.md("""
    Saved as `mine.py`, a task trains a controller of its own:

        salpchain train --task mine:Hover --world current --length 8 --out runs/hover

    Settings and measures of its own, a target that moves: the recipe *A task* in the docs.
    """)
    return


if __name__ == "__main__":
    app.run()
