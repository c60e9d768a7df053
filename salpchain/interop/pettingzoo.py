"""SCLD as a PettingZoo parallel environment: one agent for each unit, one reward for all."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from salpchain.checks import one_of
from salpchain.errors import InputError
from salpchain.given import told
from salpchain.interop.batch import Batch, Outcome
from salpchain.interop.checks import checked_render_mode, task_of
from salpchain.interop.drawing import Frame, Screen
from salpchain.interop.extras import need
from salpchain.world.randomise import WorldLike

need("pettingzoo", "pettingzoo")
need("gymnasium", "pettingzoo")

from gymnasium.spaces import Box, Space
from pettingzoo import ParallelEnv

Of = dict[str, Any]  # by the name of an agent


class SalpParallelEnv(ParallelEnv):
    """One chain whose units `unit_0`, `unit_1`, ... each see and act for themselves.

    An observation is (feature,), an action (act,) in [-1, 1]. The reward is the chain's, the same
    for every unit, and all units end together.

    Raises:
        InputError: an invalid setting of the task or render mode.
    """

    metadata = {  # noqa: RUF012
        "name": "scld_v0",
        "render_modes": ["rgb_array", "human"],
        "render_fps": 10,
        "is_parallelizable": True,
    }

    def __init__(
        self, render_mode: str | None = None, world: WorldLike = None, **task: Any
    ) -> None:
        """The task by the fields of `TaskConfig`, the world as in `SCLD`, e.g. `"rough"`."""
        self.render_mode = checked_render_mode(render_mode, self.metadata["render_modes"])
        self._batch = Batch(task_of(task), 1, renew=False, world=world)
        (units, features), (_, act) = self._batch.observation_shape, self._batch.action_shape
        self.possible_agents = [f"unit_{index}" for index in range(units)]
        self.agents: list[str] = []
        self.observation_spaces = self._each(lambda: Box(-np.inf, np.inf, (features,), np.float32))
        self.action_spaces = self._each(lambda: Box(-1.0, 1.0, (act,), np.float32))
        self._screen = Screen()

    def _each(self, make: Any) -> Of:
        return {agent: make() for agent in self.possible_agents}

    def observation_space(self, agent: str) -> Space:
        """What a unit may observe.

        Raises:
            InputError: there is no such unit.
        """
        return self.observation_spaces[self._known(agent)]

    def action_space(self, agent: str) -> Space:
        """What a unit may do.

        Raises:
            InputError: there is no such unit.
        """
        return self.action_spaces[self._known(agent)]

    def _known(self, agent: Any) -> str:
        one_of("unit", agent, self.possible_agents)
        return agent

    def reset(self, seed: int | None = None, options: Of | None = None) -> tuple[Of, Of]:
        """First observations of a new episode, and an empty info, for each unit.

        There are no options; PettingZoo wants any to be taken.

        Raises:
            InputError: an invalid seed.
        """
        obs = np.array(self._batch.reset(seed))[0]
        self.agents = list(self.possible_agents)
        self._show()
        return dict(zip(self.agents, obs, strict=True)), self._each(dict)

    def step(self, actions: Of) -> tuple[Of, Of, Of, Of, Of]:
        """Observation, reward, terminated, truncated, info of each unit after 0.1 s.

        Raises:
            InputError: before reset or after the end; an action that is missing, of a wrong shape
                or type, or not finite.
        """
        if not self.agents:
            raise InputError("no unit is alive: call reset() before step()")
        self._batch.started()
        outcome = self._batch.step_one(self._stacked(actions))
        self._show()
        given = self._given(outcome)
        if outcome.terminated[0] or outcome.truncated[0]:
            self.agents = []
        return given

    def _stacked(self, actions: Of) -> np.ndarray:
        if not isinstance(actions, Mapping):
            raise InputError(f"actions must be a dict by unit, got {told(actions)}")
        missing = [agent for agent in self.agents if agent not in actions]
        if missing:
            raise InputError(f"actions must name every unit, {missing[0]} is missing")
        for agent in actions:
            if agent not in self.agents:
                raise InputError(f"unknown unit {agent!r}: there are {', '.join(self.agents)}")
        shape = self._batch.action_shape[1:]
        for agent in self.agents:
            if np.shape(actions[agent]) != shape:
                raise InputError(
                    f"the action of {agent} must have shape {shape}, got {np.shape(actions[agent])}"
                )
        return np.stack([np.asarray(actions[agent]) for agent in self.agents])

    def _given(self, outcome: Outcome) -> tuple[Of, Of, Of, Of, Of]:
        obs = dict(zip(self.agents, np.array(outcome.obs)[0], strict=True))
        reward, goal = float(outcome.reward[0]), bool(outcome.goal[0])
        terminated, truncated = bool(outcome.terminated[0]), bool(outcome.truncated[0])
        info = {
            "distance": float(outcome.distance[0]),
            "closed_fraction": float(outcome.closed_fraction[0]),
            "goal": goal,
        }
        alike = (lambda: reward), (lambda: terminated), (lambda: truncated), info.copy
        return obs, *(self._each(make) for make in alike)  # type: ignore[return-value]

    def state(self) -> np.ndarray:
        """What all units observe, (unit, feature), for central critics."""
        return np.array(self._batch.started().obs)[0]

    def render(self) -> Frame | None:
        """The picture of the present state in mode `rgb_array`; else nothing."""
        return self._screen.frame(self._batch.one(0)) if self.render_mode == "rgb_array" else None

    def _show(self) -> None:
        if self.render_mode == "human":
            self._screen.show(self._batch.one(0))

    def close(self) -> None:
        """Closes the window, if there is one."""
        self._screen.close()
