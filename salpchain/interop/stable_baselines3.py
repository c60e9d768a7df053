"""The compiled batch of chains as a vector environment of Stable-Baselines3."""

from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from salpchain.domain.config import one_of
from salpchain.interop.batch import Batch
from salpchain.interop.checks import task_of
from salpchain.interop.drawing import Screen
from salpchain.interop.extras import need

need("stable_baselines3", "stable-baselines3")

from stable_baselines3.common.vec_env import VecEnv

from salpchain.interop.gymnasium import spaces

Indices = int | Sequence[int] | None


class SalpVecEnv(VecEnv):
    """`num_envs` chains that Stable-Baselines3 trains on; wrap it in `VecMonitor` for statistics.

    Raises:
        InputError: a setting of the task, a number of chains or a render mode that cannot be.
    """

    def __init__(self, num_envs: int = 64, render_mode: str | None = None, **task: Any) -> None:
        """The task by the fields of `TaskConfig`; pictures in the render mode `rgb_array`."""
        one_of("render mode", render_mode or "rgb_array", ("rgb_array",))
        self.render_mode = render_mode
        self._batch = Batch(task_of(task), num_envs)
        self._screens = [Screen() for _ in range(num_envs)] if render_mode else []
        self._actions: Any = None
        super().__init__(num_envs, *spaces(self._batch))

    def reset(self) -> np.ndarray:
        """First observations (env, unit, feature) of new episodes, from the seed last given."""
        given = self._seeds[0]
        self._reset_seeds()
        return np.array(self._batch.reset(given))

    def step_async(self, actions: np.ndarray) -> None:
        """Takes the actions of the next step."""
        self._actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Observations, rewards, dones and infos after one control step (0.1 s)."""
        outcome = self._batch.step(self._actions)
        truncated = np.asarray(outcome.truncated)
        done = np.asarray(outcome.terminated) | truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        last, goal = np.array(outcome.final_obs), np.asarray(outcome.goal)
        for index in np.flatnonzero(done):
            infos[index] = {
                "terminal_observation": last[index],
                "TimeLimit.truncated": bool(truncated[index]),
                "is_success": bool(goal[index]),
            }
        return np.array(outcome.obs), np.array(outcome.reward), done, infos

    def get_images(self) -> list[np.ndarray | None]:
        """The picture of every chain in mode `rgb_array`; else none."""
        if not self._screens:
            return [None] * self.num_envs
        states = self._batch.started()
        pick = lambda index: jax.tree.map(lambda leaf: leaf[index], states)  # noqa: E731
        return [screen.frame(pick(index)) for index, screen in enumerate(self._screens)]

    def close(self) -> None:
        """Nothing to close."""

    def get_attr(self, attr_name: str, indices: Indices = None) -> list[Any]:
        """The attribute of this object, once for each chain."""
        return [getattr(self, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: Indices = None) -> None:
        """Sets the attribute, for all chains alike."""
        setattr(self, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: Indices = None, **method_kwargs: Any
    ) -> list[Any]:
        """What the method returns, called once and repeated for each chain."""
        value = getattr(self, method_name)(*method_args, **method_kwargs)
        return [value] * len(list(self._get_indices(indices)))

    def env_is_wrapped(self, wrapper_class: Any, indices: Indices = None) -> list[bool]:
        """False for each chain: nothing wraps a single one."""
        return [False] * len(list(self._get_indices(indices)))
