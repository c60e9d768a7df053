"""The compiled batch of chains as a vector environment of Stable-Baselines3."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from salpchain.errors import InputError
from salpchain.given import index, told
from salpchain.interop.batch import Batch
from salpchain.interop.checks import check_options, checked_render_mode, checked_seed, task_of
from salpchain.interop.drawing import Screen
from salpchain.interop.extras import need
from salpchain.world.randomise import WorldLike

need("stable_baselines3", "stable-baselines3")

from stable_baselines3.common.vec_env import VecEnv

from salpchain.interop.gymnasium import spaces

Indices = int | Sequence[int] | None


class SalpVecEnv(VecEnv):
    """`num_envs` chains that Stable-Baselines3 trains on; wrap it in `VecMonitor` for statistics.

    Raises:
        InputError: an invalid setting of the task, number of chains or render mode.
    """

    def __init__(
        self,
        num_envs: int = 64,
        render_mode: str | None = None,
        world: WorldLike = None,
        **task: Any,
    ) -> None:
        """The task by the fields of `TaskConfig`; pictures in the render mode `rgb_array`.

        The world is as in `SCLD`, e.g. `"rough"`.
        """
        self.render_mode = checked_render_mode(render_mode, ("rgb_array",))
        self._batch = Batch(task_of(task), num_envs, world=world)
        self._screens = [Screen() for _ in range(num_envs)] if render_mode else []
        self._actions: Any = None
        super().__init__(num_envs, *spaces(self._batch))

    def reset(self) -> np.ndarray:
        """First observations (env, unit, feature) of new episodes, from the seed last given."""
        given = self._seeds[0]
        self._reset_seeds()
        return np.array(self._batch.reset(given))

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """The next `reset` starts the episodes of seed, seed + 1, ...; gives the seeds.

        Raises:
            InputError: no whole number from 0 on.
        """
        return super().seed(None if seed is None else checked_seed(seed))

    def set_options(self, options: list[dict] | dict | None = None) -> None:
        """Refuses options of the next reset: there are none.

        Raises:
            InputError: an option.
        """
        for each in options if isinstance(options, list) else [options]:
            check_options(each, ())

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
        for over in np.flatnonzero(done):
            infos[over] = {
                "terminal_observation": last[over],
                "TimeLimit.truncated": bool(truncated[over]),
                "is_success": bool(goal[over]),
            }
        return np.array(outcome.obs), np.array(outcome.reward), done, infos

    def get_images(self) -> list[np.ndarray | None]:
        """The picture of every chain in mode `rgb_array`; else none."""
        return self._render_chains(list(range(self.num_envs)))

    def close(self) -> None:
        """Nothing to close."""

    def get_attr(self, attr_name: str, indices: Indices = None) -> list[Any]:
        """The attribute of this object, once for each chain asked for."""
        return [getattr(self, attr_name)] * len(self._chosen(indices))

    def set_attr(self, attr_name: str, value: Any, indices: Indices = None) -> None:
        """Sets the attribute, which all chains share.

        Raises:
            InputError: for some of the chains alone.
        """
        self._check_all(f"set the attribute {attr_name}", self._chosen(indices))
        setattr(self, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: Indices = None, **method_kwargs: Any
    ) -> list[Any]:
        """What the method gives for each chain asked for, and done to no other.

        `reset` (first observation and info, with a `seed` if given) and `render` (a picture) are
        for single chains too; any other method of this object is called once for all chains.

        Raises:
            InputError: another method for some of the chains alone; a chain that is not there.
        """
        chosen = self._chosen(indices)
        if not isinstance(method_name, str) or not hasattr(self, method_name):
            raise InputError(f"there is no method {told(method_name)}")
        if method_name in ("reset", "render"):
            own = self._reset_chains if method_name == "reset" else self._render_chains
            return own(chosen, *method_args, **method_kwargs)
        self._check_all(f"call {method_name}", chosen)
        value = getattr(self, method_name)(*method_args, **method_kwargs)
        return [value] * len(chosen)

    def env_is_wrapped(self, wrapper_class: Any, indices: Indices = None) -> list[bool]:
        """False for each chain asked for: nothing wraps a single one."""
        return [False] * len(self._chosen(indices))

    def _chosen(self, indices: Indices) -> list[int]:
        """The numbers of the chains; negative ones count from the last.

        Raises:
            InputError: a chain that is not there.
        """
        given: Any = range(self.num_envs) if indices is None else indices
        listed = isinstance(given, list | tuple | range) or np.ndim(given) == 1
        chosen: list[Any] = list(given) if listed else [given]
        for each in chosen:
            number = index(each)
            if number is None or not -self.num_envs <= number < self.num_envs:
                raise InputError(f"no chain {told(each)}: there are 0 to {self.num_envs - 1}")
        return [int(each) % self.num_envs for each in chosen]

    def _check_all(self, what: str, chosen: list[int]) -> None:
        if set(chosen) != set(range(self.num_envs)):
            raise InputError(
                f"cannot {what} for chains {chosen} alone: the {self.num_envs} chains are one"
                " object; leave indices out, or make a second environment"
            )

    def _reset_chains(
        self, chosen: list[int], seed: int | None = None, options: Any = None
    ) -> list[tuple[np.ndarray, dict[str, Any]]]:
        """New episodes of these chains alone; chain i of a seed starts as in `reset`."""
        check_options(options, ())
        if self._batch.states is None and len(set(chosen)) < self.num_envs:
            raise InputError("the environment was never reset: call reset() first")
        if self._batch.states is None:
            obs = np.array(self._batch.reset(seed))
        else:
            obs = np.array(self._batch.reset_some(np.isin(range(self.num_envs), chosen), seed))
        return [(obs[index], {}) for index in chosen]

    def _render_chains(self, chosen: list[int]) -> list[np.ndarray | None]:
        """The pictures of these chains; none without the render mode."""
        if not self._screens:
            return [None] * len(chosen)
        return [self._screens[i].frame(self._batch.one(i)) for i in chosen]
