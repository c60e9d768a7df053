"""SCLD as a Gymnasium environment, and as a native vector environment of one compiled program.

Importing this module registers `salpchain/SCLD-v0`. One agent sees and steers the whole chain:
an observation is (unit, feature), an action (unit, act) in [-1, 1]. Every field of `TaskConfig` is
a keyword of `gymnasium.make`.
"""

from typing import Any

import jax
import numpy as np

from salpchain.errors import InputError
from salpchain.interop.batch import Batch, Outcome, task_of
from salpchain.interop.drawing import Frame, Screen
from salpchain.interop.extras import need

need("gymnasium", "gymnasium")

import gymnasium
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

ID = "salpchain/SCLD-v0"
FRAMES = 10  # for each second: one a control step
MEASURES = ("distance", "closed_fraction", "goal")  # of an Outcome, told in `info`

Spaces = tuple[Box, Box]


def spaces(batch: Batch) -> Spaces:
    """Observation and action space of one chain."""
    seen = Box(-np.inf, np.inf, batch.observation_shape, np.float32)
    return seen, Box(-1.0, 1.0, batch.action_shape, np.float32)


class SalpEnv(gymnasium.Env):
    """One chain. `info` has its mean distance (m), closed fraction and whether the goal is taken.

    Raises:
        InputError: a setting of the task, or a render mode, that cannot be.
    """

    metadata = {"render_modes": ["rgb_array", "human"], "render_fps": FRAMES}  # noqa: RUF012

    def __init__(self, render_mode: str | None = None, **task: Any) -> None:
        """The task by the fields of `TaskConfig`, e.g. `length=8, observation="table1"`."""
        self.render_mode = _checked(render_mode, self.metadata["render_modes"])
        self._batch = Batch(task_of(task), 1, renew=False)
        self.observation_space, self.action_space = spaces(self._batch)
        self._screen = Screen()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """First observation of a new episode; it follows from the seed."""
        super().reset(seed=seed)
        obs = np.array(self._batch.reset(seed))[0]
        self._show()
        return obs, {}

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Observation, reward, terminated, truncated, info after one control step (0.1 s).

        Raises:
            InputError: before reset; an action of a wrong shape or type, or not finite.
        """
        outcome = self._batch.step(np.asarray(action)[None])
        info = {name: np.asarray(getattr(outcome, name))[0].item() for name in MEASURES}
        self._show()
        ends = bool(outcome.terminated[0]), bool(outcome.truncated[0])
        return np.array(outcome.obs)[0], float(outcome.reward[0]), *ends, info

    def render(self) -> Frame | None:  # type: ignore[override]
        """The picture of the present state in mode `rgb_array`; else nothing."""
        if self.render_mode == "rgb_array":
            return self._screen.frame(_one(self._batch.started(), 0))
        return None

    def _show(self) -> None:
        if self.render_mode == "human":
            self._screen.show(_one(self._batch.started(), 0))

    def close(self) -> None:
        """Closes the window, if there is one."""
        self._screen.close()


class SalpVectorEnv(VectorEnv):
    """`num_envs` chains stepped by one compiled program; finished episodes begin anew at once.

    Chain i of seed s plays what `SalpEnv` plays with seed s + i. Where an episode ended,
    `info["final_obs"]` and `info["final_info"]` hold its last, as Gymnasium has it.

    Raises:
        InputError: a setting of the task, a number of chains or a render mode that cannot be.
    """

    metadata = {  # noqa: RUF012
        "autoreset_mode": AutoresetMode.SAME_STEP,
        "render_modes": ["rgb_array"],
        "render_fps": FRAMES,
    }

    def __init__(self, num_envs: int = 1, render_mode: str | None = None, **task: Any) -> None:
        """The task by the fields of `TaskConfig`."""
        self.render_mode = _checked(render_mode, self.metadata["render_modes"])
        self._batch = Batch(task_of(task), num_envs)
        self.num_envs = num_envs
        self.single_observation_space, self.single_action_space = spaces(self._batch)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._screens = [Screen() for _ in range(num_envs)] if render_mode else []

    def reset(  # type: ignore[override]
        self, *, seed: int | list[int] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """First observations (env, unit, feature) of new episodes.

        Raises:
            InputError: seeds that cannot be, or not one for each chain.
        """
        super().reset(seed=seed[0] if isinstance(seed, list) else seed)
        return np.array(self._batch.reset(seed)), {}

    def step(
        self, actions: Any
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Observations, rewards, terminated, truncated, info after one control step (0.1 s).

        Raises:
            InputError: before reset; actions of a wrong shape or type, or not finite.
        """
        outcome = self._batch.step(actions)
        rewards = np.array(outcome.reward, np.float64)
        terminated, truncated = np.array(outcome.terminated), np.array(outcome.truncated)
        infos = _infos(outcome, terminated | truncated)
        return np.array(outcome.obs), rewards, terminated, truncated, infos

    def render(self) -> tuple[Frame, ...] | None:
        """The picture of every chain in mode `rgb_array`; else nothing."""
        states = self._batch.started()
        frames = (screen.frame(_one(states, i)) for i, screen in enumerate(self._screens))
        return tuple(frames) or None


def _checked(mode: str | None, modes: list[str]) -> str | None:
    if mode is not None and mode not in modes:
        raise InputError(f"unknown render mode {mode!r}: choose one of {', '.join(modes)}")
    return mode


def _one(states: Any, index: int) -> Any:
    return jax.tree.map(lambda leaf: leaf[index], states)


def _infos(outcome: Outcome, done: np.ndarray) -> dict[str, Any]:
    """`info` in Gymnasium's layout: each value with a mask `_name` of the chains that have it."""
    measures = {name: np.array(getattr(outcome, name)) for name in MEASURES}
    infos = _masked(measures, ~done)
    if done.any():
        final_obs, last = np.full(len(done), None, object), np.array(outcome.final_obs)
        for index in np.flatnonzero(done):
            final_obs[index] = last[index]
        infos |= {"final_obs": final_obs, "_final_obs": done.copy()}
        infos |= {"final_info": _masked(measures, done), "_final_info": done.copy()}
    return infos


def _masked(measures: dict[str, np.ndarray], there: np.ndarray) -> dict[str, Any]:
    values = {
        name: np.where(there, value, 0).astype(value.dtype) for name, value in measures.items()
    }
    return values | {f"_{name}": there.copy() for name in measures}


if ID not in gymnasium.registry:
    gymnasium.register(
        ID,
        entry_point="salpchain.interop.gymnasium:SalpEnv",
        vector_entry_point="salpchain.interop.gymnasium:SalpVectorEnv",
    )
