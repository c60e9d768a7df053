"""SCLD as a Gymnasium environment, and as a native vector environment of one compiled program.

Importing this module registers `salpchain/SCLD-v0`. One agent sees and steers the whole chain:
an observation is (unit, feature), an action (unit, act) in [-1, 1]. Every field of `TaskConfig` is
a keyword of `gymnasium.make`.
"""

from typing import Any

import numpy as np

from salpchain.checks import one_of
from salpchain.errors import InputError
from salpchain.interop.batch import Batch, Outcome, Seeds
from salpchain.interop.checks import check_options, checked_render_mode, checked_seed, task_of
from salpchain.interop.drawing import Frame, Screen
from salpchain.interop.extras import need
from salpchain.world.randomise import WorldLike

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
        InputError: an invalid setting of the task or render mode.
    """

    metadata = {"render_modes": ["rgb_array", "human"], "render_fps": FRAMES}  # noqa: RUF012

    def __init__(
        self, render_mode: str | None = None, world: WorldLike = None, **task: Any
    ) -> None:
        """The task by the fields of `TaskConfig`, e.g. `length=8, observation="table1"`.

        `world` is the name of one, or what `SCLD` takes: a `WorldConfig`, a `Physics`, a `World`.
        """
        self.render_mode = checked_render_mode(render_mode, self.metadata["render_modes"])
        self._batch = Batch(task_of(task), 1, renew=False, world=world)
        self.observation_space, self.action_space = spaces(self._batch)
        self._screen = Screen()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """First observation of a new episode; it follows from the seed.

        Raises:
            InputError: an invalid seed, or an option: there are none.
        """
        check_options(options, ())
        super().reset(seed=None if seed is None else checked_seed(seed))
        obs = np.array(self._batch.reset(seed))[0]
        self._show()
        return obs, {}

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Observation, reward, terminated, truncated, info after one control step (0.1 s).

        Raises:
            InputError: before reset; an action of a wrong shape or type, or not finite.
        """
        outcome = self._batch.step_one(action)
        info = {name: np.asarray(getattr(outcome, name))[0].item() for name in MEASURES}
        self._show()
        ends = bool(outcome.terminated[0]), bool(outcome.truncated[0])
        return np.array(outcome.obs)[0], float(outcome.reward[0]), *ends, info

    def render(self) -> Frame | None:  # type: ignore[override]
        """The picture of the present state in mode `rgb_array`; else nothing."""
        if self.render_mode == "rgb_array":
            return self._screen.frame(self._batch.one(0))
        return None

    def _show(self) -> None:
        if self.render_mode == "human":
            self._screen.show(self._batch.one(0))

    def close(self) -> None:
        """Closes the window, if there is one."""
        self._screen.close()


class SalpVectorEnv(VectorEnv):
    """`num_envs` chains stepped by one compiled program.

    What follows a finished episode is Gymnasium's autoreset mode: a new one in the next step, as
    its own vector environments do (the action of that chain is then ignored, its reward is 0), a
    new one in the same step (`autoreset_mode="SameStep"`, the last observation and info of the old
    one are then in `info["final_obs"]` and `info["final_info"]`), or nothing until
    `reset(options={"reset_mask": ...})` (`"Disabled"`). Chain i of seed s starts as `SalpEnv` does
    with seed s + i.

    Raises:
        InputError: a setting of the task, a number of chains, a time limit, a mode of autoreset or
            of rendering that cannot be.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": FRAMES}  # noqa: RUF012

    def __init__(
        self,
        num_envs: int = 1,
        render_mode: str | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        max_episode_steps: int | None = None,
        world: WorldLike = None,
        **task: Any,
    ) -> None:
        """The task by the fields of `TaskConfig`; truncated at its time limit, or earlier."""
        self.render_mode = checked_render_mode(render_mode, self.metadata["render_modes"])
        self._mode = _mode(autoreset_mode)
        self.metadata = {**self.metadata, "autoreset_mode": self._mode}
        same_step = self._mode is AutoresetMode.SAME_STEP
        self._batch = Batch(task_of(task), num_envs, same_step, max_episode_steps, world)
        self._over = np.zeros(num_envs, bool)  # whose episode ended and was not begun anew
        self.num_envs = num_envs
        self.single_observation_space, self.single_action_space = spaces(self._batch)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._screens = [Screen() for _ in range(num_envs)] if render_mode else []

    def reset(  # type: ignore[override]
        self, *, seed: Seeds = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """First observations (env, unit, feature) of new episodes.

        With `options={"reset_mask": mask}`, (env,) booleans, of the chains of the mask alone; the
        others go on.

        Raises:
            InputError: seeds that cannot be, or not one for each chain; a mask that is not one
                boolean for each; another option.
        """
        mask = check_options(options, ("reset_mask",)).get("reset_mask")
        self._batch.check_seeds(seed)
        super().reset(seed=seed if isinstance(seed, int) else None)
        if mask is None:
            obs, self._over = self._batch.reset(seed), np.zeros(self.num_envs, bool)
        else:
            obs = self._batch.reset_some(mask, seed)
            self._over = self._over & ~np.asarray(mask)
        return np.array(obs), {}

    def step(
        self, actions: Any
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Observations, rewards, terminated, truncated, info after one control step (0.1 s).

        Raises:
            InputError: before reset, or after an episode's end where autoreset is disabled;
                actions of a wrong shape or type, or not finite.
        """
        begun = self._begun_anew()
        next_step = self._mode is AutoresetMode.NEXT_STEP
        batch = self._batch
        outcome = batch.step_or_renew(actions, begun) if next_step else batch.step(actions)
        rewards = np.where(begun, 0.0, np.array(outcome.reward, np.float64))
        ends = np.array(outcome.terminated) & ~begun, np.array(outcome.truncated) & ~begun
        done = ends[0] | ends[1]
        if self._mode is AutoresetMode.SAME_STEP:
            return np.array(outcome.obs), rewards, *ends, _infos(outcome, done)
        self._over = done
        return np.array(outcome.obs), rewards, *ends, _masked(_measures(outcome), ~begun)

    def _begun_anew(self) -> np.ndarray:
        """Which chains get a new episode in the next step, instead of a step."""
        if self._mode is AutoresetMode.DISABLED and self._over.any():
            raise InputError(
                f"the episode of environment {np.argmax(self._over)} is over: reset it with"
                ' options={"reset_mask": ...}'
            )
        return self._over

    def render(self) -> tuple[Frame, ...] | None:
        """The picture of every chain in mode `rgb_array`; else nothing."""
        self._batch.started()
        frames = (screen.frame(self._batch.one(i)) for i, screen in enumerate(self._screens))
        return tuple(frames) or None


def _mode(mode: AutoresetMode | str) -> AutoresetMode:
    known = {name: each for each in AutoresetMode for name in (each.name, each.value)}
    name = mode.name if isinstance(mode, AutoresetMode) else mode
    one_of("autoreset mode", name, known)
    return known[name]


def _infos(outcome: Outcome, done: np.ndarray) -> dict[str, Any]:
    """`info` in Gymnasium's layout: each value with a mask `_name` of the chains that have it."""
    measures = _measures(outcome)
    infos = _masked(measures, ~done)
    if done.any():
        final_obs, last = np.full(len(done), None, object), np.array(outcome.final_obs)
        for index in np.flatnonzero(done):
            final_obs[index] = last[index]
        infos |= {"final_obs": final_obs, "_final_obs": done.copy()}
        infos |= {"final_info": _masked(measures, done), "_final_info": done.copy()}
    return infos


def _measures(outcome: Outcome) -> dict[str, np.ndarray]:
    return {name: np.array(getattr(outcome, name)) for name in MEASURES}


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
