"""Does a policy hold outside its engine? python -m studies.transfer.run POLICY OUT

Plays it in the real VMAS beside ours, from the same starts to the same targets, and with physics,
sensors and delays that it never saw. Writes OUT/results/vmas.csv, OUT/results/changed.csv and
OUT/report.md. What is there already is kept, so a run that was stopped goes on.
"""

import sys
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
import torch

from salpchain.controllers.policy import Policy
from salpchain.controllers.storage import load
from salpchain.devices import use_devices
from salpchain.errors import InputError
from salpchain.evaluation.trials import run_trials
from salpchain.experiments.results import REPORT_FILE, RESULTS, add_part, claim, results_of
from salpchain.files import write_text
from salpchain.interop.steer import steering
from salpchain.interop.vmas import make_env
from salpchain.physics.state import Physics, at_rest
from salpchain.ranges import as_range
from salpchain.tasks.config import TaskConfig, step_limit
from salpchain.tasks.reach.task import SCLD
from salpchain.tasks.state import State
from salpchain.world.config import SensingConfig, WorldConfig
from salpchain.world.randomise import WorldLike
from studies import program

LENGTHS = (4, 8, 16, 32)
TRIALS = 200
SEED = 3000  # of the starts that judge (chosen)
LIMIT = "scaled"


def changed(
    mass: float = 1.0, drag: float = 1.0, stiffness: float = 1.0, thrust: float = 1.0
) -> Physics:
    """The paper's physics with its constants multiplied: masses, drag, stiffness of the joints.

    A larger thrust limit is the same as smaller masses and weaker springs, so it is made of these.
    """
    plain = Physics()
    return Physics(
        unit_mass=plain.unit_mass * mass / thrust,
        link_mass=plain.link_mass * mass / thrust,
        drag=plain.drag * drag,
        joint_stiffness=plain.joint_stiffness * stiffness / thrust,
        angle_stiffness=plain.angle_stiffness * stiffness / thrust,
        contact_stiffness=plain.contact_stiffness / thrust,
    )


# What is otherwise than in training, by name
NOISE = SensingConfig(position=as_range(0.005), angle=as_range(float(np.deg2rad(3))))
SETTINGS: dict[str, WorldLike] = {
    "nothing": Physics(),
    **{
        f"{name} {100 * (factor - 1):+.0f} %": changed(**{name: factor})
        for name in ("mass", "drag", "stiffness", "thrust")
        for factor in (0.8, 1.2)
    },
    "noise 5 mm, 3 degrees": WorldConfig(sensing=NOISE),
    "delay 0.1 s": WorldConfig(sensing=SensingConfig(action_delay=as_range(1.0))),
}


def in_vmas(policy: Policy, length: int, trials: int) -> pd.DataFrame:
    """A row for each engine and trial: success and closed fraction."""
    card = policy.card
    task = {"length": length, "observation": card.observation, "action": card.action}
    env = make_env(trials, seed=SEED, time_limit=LIMIT, **task)
    chains, limit = env.scenario.chains(), step_limit(LIMIT, length)
    place, angle, target = (
        x.numpy().copy() for x in (chains.position, chains.angle, chains.target)
    )
    rows = [("VMAS", *_swim_there(env, steering(policy, time_limit=LIMIT, **task), limit))]
    rows.append(("ours", *_swim_here(policy, place, angle, target, limit)))
    return pd.concat([
        pd.DataFrame({"engine": engine, "length": length, "trial": range(trials),
                      "success": success, "closed_fraction": closed})
        for engine, success, closed in rows
    ])  # fmt: skip


def _swim_there(env: Any, steer: Any, limit: int) -> tuple[np.ndarray, np.ndarray]:
    """Success and closed fraction (env,) at the end of each episode in VMAS."""
    success = np.zeros(env.num_envs, bool)
    closed = np.zeros(env.num_envs)
    seen = env.get_from_scenario(True, False, False, False)[0]
    for _ in range(limit):
        actions = steer(torch.stack(seen, dim=1).numpy())
        given = [torch.from_numpy(actions[:, unit]) for unit in range(actions.shape[1])]
        seen, _, goal, _, infos = env.step(given)
        now = infos[0]["closed_fraction"][:, 0].numpy()
        closed = np.where(success, closed, now)
        success |= goal.numpy()
        if success.all():
            break
    return success, closed


def _swim_here(
    policy: Policy, place: np.ndarray, angle: np.ndarray, target: np.ndarray, limit: int
) -> tuple[np.ndarray, np.ndarray]:
    """The same in our engine, from the same starts."""
    card, length = policy.card, place.shape[1]
    env = SCLD(TaskConfig(length, card.observation, card.action, LIMIT))

    def start(place: jax.Array, angle: jax.Array, target: jax.Array, key: jax.Array) -> State:
        return env.start(at_rest(place, angle), target, key)

    def advance(_: int, states: State) -> State:
        after = jax.vmap(lambda state: env.step(state, policy.act(state)))(states)
        over = states.done
        keep = lambda old, new: jnp.where(over.reshape(-1, *[1] * (new.ndim - 1)), old, new)  # noqa: E731
        return jax.tree.map(keep, states, after)

    keys = jax.random.split(jax.random.key(0), len(place))
    begun = jax.vmap(start)(*map(jnp.asarray, (place, angle, target)), keys)
    ended = jax.jit(lambda states: jax.lax.fori_loop(0, limit, advance, states))(begun)
    return np.asarray(ended.goal), np.asarray(ended.closed_fraction)


def with_changes(policy: Policy, setting: str, length: int, trials: int) -> pd.DataFrame:
    """The trials of one setting."""
    (frame,) = run_trials([policy], length, trials, LIMIT, SEED, world=SETTINGS[setting])
    return frame.assign(setting=setting)[
        ["setting", "length", "trial", "success", "closed_fraction"]
    ]


def study(policy: Policy, out: Path, trials: int = TRIALS) -> None:
    """All of it, part by part."""
    results = results_of(out)
    claim(results, "transfer", policy, trials=trials, seed=SEED, time_limit=LIMIT)
    for setting in SETTINGS:
        for length in LENGTHS:
            part = {"setting": setting, "length": length}
            play = lambda s=setting, n=length: with_changes(policy, s, n, trials)  # noqa: E731
            add_part(results / "changed.csv", part, play)
    for length in LENGTHS:
        play = lambda n=length: in_vmas(policy, n, trials)  # noqa: E731
        add_part(results / "vmas.csv", {"length": length}, play)
    write_text(out / REPORT_FILE, report(policy.card.name, out, trials))


def report(name: str, out: Path, trials: int) -> str:
    """Both tables in Markdown."""
    parts = [f"# `{name}` outside the engine it was trained in\n"]
    about = (
        f"{trials} episodes of each length, time limit `{LIMIT}`, seed {SEED}. Success (closed).\n"
    )
    for file, by in (("vmas.csv", "engine"), ("changed.csv", "setting")):
        frame = pd.read_csv(out / RESULTS / file)
        rows = frame.groupby([by, "length"], sort=False)[["success", "closed_fraction"]].mean()
        lengths = frame.length.unique()
        parts += [about, f"| {by} | " + " | ".join(f"{n} units" for n in lengths) + " |"]
        parts.append("| --- |" + " --- |" * len(lengths))
        for kind in frame[by].unique():
            cells = (rows.loc[(kind, n)] for n in lengths)
            shown = (f"{100 * c.success:.1f} ({100 * c.closed_fraction:.1f})" for c in cells)
            parts.append(f"| {kind} | " + " | ".join(shown) + " |")
        parts.append("")
    return "\n".join(parts)


def main() -> None:
    """Studies the policy that the command line names."""
    if len(sys.argv) != 3:
        raise InputError("give a policy and a folder: python -m studies.transfer.run NAME OUT")
    use_devices()
    study(load(sys.argv[1]), Path(sys.argv[2]))


if __name__ == "__main__":
    program("transfer", main, __doc__)
