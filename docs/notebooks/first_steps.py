"""First steps, as a marimo notebook: `marimo edit docs/notebooks/first_steps.py`."""

import marimo

app = marimo.App(app_title="salpchain: first steps")


@app.cell
def _():
    import jax
    import marimo as mo
    import matplotlib.pyplot as plt
    import numpy as np

    import salpchain

    return jax, mo, np, plt, salpchain


@app.cell
def _(mo):
    mo.md("""
    # First steps

    A chain of units swims to a target pose. Each unit has one jet, across the chain; no link
    has a motor.
    One controller, trained on 2 to 16 units, steers them all. Choose a length:
    """)
    return


@app.cell
def _(mo):
    length = mo.ui.slider(2, 64, value=12, label="units")
    seed = mo.ui.slider(0, 20, value=3, label="start")
    mo.hstack([length, seed])
    return length, seed


@app.cell
def _(length, salpchain, seed):
    policy = salpchain.load("any-length")
    (swim,) = salpchain.record(policy, [length.value], seed=seed.value)
    closed_way = f"closed {100 * swim.closed_fraction:.0f} % of the distance"
    said = f"{swim.length} units, {swim.steps * 0.1:.1f} s: {closed_way}"
    return policy, said, swim


@app.cell
def _(mo, said):
    mo.md(f"**{said}**")
    return


@app.cell
def _(np, plt, swim):
    figure, (water, curve) = plt.subplots(1, 2, figsize=(9, 4))
    for time in np.linspace(0, swim.steps, 5).astype(int):
        water.plot(*swim.unit_position[time].T, ".-", alpha=0.3 + 0.7 * time / swim.steps)
    water.plot(*swim.target.T, "o", fillstyle="none", color="grey")
    water.set(aspect="equal", xlabel="x (m)", ylabel="y (m)", title="five moments, and the target")
    curve.plot(0.1 * np.arange(swim.steps + 1), swim.distance)
    curve.set(xlabel="time (s)", ylabel="mean distance to the target (m)", ylim=0)
    figure.tight_layout()
    figure
    return


@app.cell
def _(mo):
    mo.md("""
    ## A loop of your own

    `reset` and `step` are pure functions of one chain: `jax.vmap` makes them a batch, and
    `jax.jit` fast.
    """)
    return


@app.cell
def _(jax, length, policy, salpchain):
    env = salpchain.SCLD(policy.card.task(length.value))
    states = jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.key(0), 8))
    advance = jax.jit(lambda states: jax.vmap(env.step)(states, jax.vmap(policy.act)(states)))
    for _ in range(200):  # 20 s
        states = advance(states)
    closed = states.closed_fraction
    return (closed,)


@app.cell
def _(closed, mo):
    mo.md(f"Eight other chains closed {100 * float(closed.mean()):.0f} % of their way in 20 s.")
    return


if __name__ == "__main__":
    app.run()
