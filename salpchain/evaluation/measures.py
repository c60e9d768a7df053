"""What is measured of a trial, one episode."""

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float, Int

from salpchain.evaluation.difficulty import Start, centroid
from salpchain.tasks.state import State
from salpchain.tasks.task import Task


class Trial(eqx.Module):
    """One episode, with the sums that its measures need; in a batch, axes (trial, controller)."""

    state: State
    start: Start
    effort: Float[Array, ""]  # N s, mean over units of the sum of |thrust| dt
    path: Float[Array, ""]  # m, way of the centroid
    contact_steps: Int[Array, ""]  # control steps in which some two units pushed each other
    series: dict[str, Float[Array, "*batch step"]]  # what the task reads off each control step


def measures(env: Task, trials: Trial) -> dict[str, np.ndarray]:
    """The measures of finished trials by name, each (trial, controller).

    success, closed_fraction, final_distance (m), start_distance (m), steps_to_goal (NaN without
    success), steps, thrust_effort (N s per unit), path_efficiency (NaN for a chain that never
    moved), contact_time (s, of the control steps in which two units pushed each other), `_limits`,
    regret (what is missing to reachable; 0 for a success), time_ratio (steps to the goal over the
    fewest). Then the task's own.
    """
    state = trials.state
    success, time = np.asarray(state.goal), np.asarray(state.time)
    moved = jax.vmap(jax.vmap(centroid))(state.chain) - trials.start.origin
    straight = np.linalg.norm(np.asarray(moved, np.float64), axis=-1)
    path = np.asarray(trials.path, np.float64)
    final, start = (np.asarray(x, np.float64) for x in (state.distances.mean, state.start_distance))
    given, steps_to_goal = _limits(env, trials), np.where(success, time, np.nan)
    left = np.divide(final, start, np.full_like(start, np.nan), where=start > 0)
    return {
        "success": success,
        "closed_fraction": 1 - left,
        "final_distance": final,
        "start_distance": start,
        "steps_to_goal": steps_to_goal,
        "steps": time,
        "thrust_effort": np.asarray(trials.effort, np.float64),
        "path_efficiency": np.divide(straight, path, np.full_like(path, np.nan), where=path > 0),
        "contact_time": np.asarray(trials.contact_steps) * env.physics.control_step,
        **given,
        "regret": np.where(success, 0.0, given["reachable"] - (1 - left)),
        "time_ratio": steps_to_goal / given["fewest_steps"],
        **_own(env, trials.series, time),
    }


def _limits(env: Task, trials: Trial) -> dict[str, np.ndarray]:
    """What is told of trials from their starts, each (trial, controller).

    reachable and fewest_steps (the physical limits of closed_fraction and of steps to the goal),
    turn_steps (before which no chain that stays straight has turned to the target's direction), how
    hard the start is: far (mean distance in lengths of the chain), turn and bend (rad), possible
    (whether the limits allow the goal, as far as is known). Where the target moves, or the water by
    chance, nothing is known of what physics allows: NaN.
    """
    start = trials.start
    known = np.asarray(start.known) & env.target_stands
    names, bounds = ("far", "turn", "bend"), ("reachable", "fewest_steps", "turn_steps")
    values = {name: np.asarray(getattr(start, name), np.float64) for name in (*bounds, *names)}
    unbound = {name: np.where(known, values[name], np.nan) for name in bounds}
    possible = np.asarray(start.possible) | (not env.target_stands)
    return {**values, **unbound, "possible": possible}


def _own(
    env: Task, series: dict[str, Array], time: Int[np.ndarray, "trial controller"]
) -> dict[str, np.ndarray]:
    """The task's own measures of each trial."""
    if not series:
        return {}
    kept = {name: np.asarray(values) for name, values in series.items()}
    found = [
        env.measure({name: values[at][:steps] for name, values in kept.items()})
        for at, steps in np.ndenumerate(time)
    ]
    return {name: np.reshape([one[name] for one in found], time.shape) for name in found[0]}
