"""SCLD as a scenario of VMAS 1.4.3 to 1.5: VMAS's own physics, torch from end to end.

`vmas.make_env(scenario=Scenario(), num_envs=..., length=...)` takes any setting of `TaskConfig`,
and a `world` as far as VMAS's physics can have it (see `torch_world`).
VMAS itself counts the steps: give `max_steps` (512 in the paper); `make_env` below does so, and
names the environment whose action is NaN.
"""

from typing import Any

from salpchain.errors import InputError
from salpchain.given import told
from salpchain.interop.checks import checked_envs, checked_seed, limit_of, reach_alone, task_of
from salpchain.interop.extras import need
from salpchain.interop.torch import checked_device
from salpchain.interop.torch_task import (
    Chains,
    heading,
    observe,
    potentials,
    reached,
    spawn,
    target_pose,
)
from salpchain.interop.torch_world import Worlds, vmas_world
from salpchain.physics.state import Physics
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.reach.targets import LINK, SPAWN
from salpchain.tasks.task import FENCE_PER_UNIT
from salpchain.world.config import WorldConfig

need("torch", "vmas")
need("vmas", "vmas")

import torch
from torch import Tensor
from vmas.simulator.core import Agent, Box, World
from vmas.simulator.dynamics.common import Dynamics
from vmas.simulator.environment import Environment
from vmas.simulator.joints import Joint
from vmas.simulator.scenario import BaseScenario
from vmas.simulator.utils import Color

TARGET_COLOUR = (0.2, 0.5, 0.8)
VIEW = 3 * LINK  # m for each unit: no target lies farther out


class Thruster(Dynamics):
    """A thrust along the heading: of `thrust` the number itself, of `pair` half the difference."""

    def __init__(self, size: int) -> None:
        """For actions of so many numbers."""
        super().__init__()
        self._size = size
        self.thrust = torch.zeros(0, 1)  # (env, 1) N, asked for

    @property
    def needed_action_size(self) -> int:
        """1 for `thrust`, 2 for `pair`."""
        return self._size

    def process_action(self) -> None:
        """Sets the force (N, world axes) that acts in the coming control step."""
        u = self.agent.action.u.clamp(-1.0, 1.0)
        self.thrust = u[:, :1] if self._size == 1 else (u[:, :1] - u[:, 1:]) / 2
        self.agent.state.force = self.thrust * heading(self.agent.state.rot[:, 0])


class Scenario(BaseScenario):
    """The Salp Chain Locomotion Domain; agents `unit_0`, `unit_1`, ... share the reward."""

    config: TaskConfig

    def make_world(self, batch_dim: int, device: Any, **kwargs: Any) -> World:
        """A world of chains; `kwargs` are settings of `TaskConfig`, and `world`.

        Raises:
            InputError: an unknown setting, an invalid one, or a world that VMAS cannot have.
        """
        around = vmas_world(kwargs.pop("world", None))
        self.config = reach_alone(task_of(kwargs))
        size = batch_dim, self.config.length, self.config.step_limit
        self._worlds = None if around.is_still else Worlds(around, *size, device)
        self.viewer_zoom = VIEW * self.config.length + SPAWN
        self._fence = FENCE_PER_UNIT * self.config.length if self.config.fence else None
        world = _world(batch_dim, device, self._fence)
        for index in range(self.config.length):
            world.add_agent(_unit(index, self.config))
        self._joints = [_joint(*pair) for pair in zip(world.agents, world.agents[1:], strict=False)]
        for joint in self._joints:
            world.add_joint(joint)
        self._target = torch.zeros(batch_dim, self.config.length, 2, device=device)
        self._start = torch.ones(batch_dim, device=device)
        self._reward = torch.zeros(batch_dim, device=device)
        self._goal = torch.zeros(batch_dim, dtype=torch.bool, device=device)
        self._approach, self._fine = self._reward.clone(), self._reward.clone()  # potentials
        self._seen: Tensor | None = None
        return world

    def reset_world_at(self, env_index: int | None = None) -> None:
        """New episodes, at rest, every joint closed; other environments stay bit-identical."""
        rows = slice(None) if env_index is None else slice(env_index, env_index + 1)
        some, length = len(self._start[rows]), self.config.length
        position, angle = spawn(some, length, self.world.device)
        self.place(position, angle, target_pose(some, length, self.world.device), rows)
        if self._worlds is not None:
            self._worlds.draw(rows)

    def place(
        self, position: Tensor, angle: Tensor, target: Tensor, rows: slice = slice(None)
    ) -> None:
        """New episodes in these environments: chains at the units' positions (env, unit, 2) m, all
        units at the angle (env,) rad, at the velocities that they have, and targets (env, unit, 2).
        """
        middle = (position[:, 1:] + position[:, :-1]) / 2
        links: list[Any] = [joint.landmark for joint in self._joints]
        # Straight into the state: VMAS's setters would place every link anew, in all environments.
        for entities, places in ((self.world.agents, position), (links, middle)):
            for index, entity in enumerate(entities):
                state: Any = entity.state
                state.pos[rows], state.rot[rows] = places[:, index], angle[:, None]
        self._target[rows] = target
        now = potentials(self._positions()[rows], self._target[rows])
        self._start[rows] = now[0]
        self._approach[rows], self._fine[rows] = now
        self._goal[rows] = False
        self._seen = None

    def pre_step(self) -> None:
        """What the thrusters make of the actions, and the drag of water that moves.

        VMAS takes a part of each velocity once in a control step; to be drag relative to water at
        c, it starts from v + c drag / (1 - drag) instead of v.
        """
        if self._worlds is None:
            return
        agents: list[Any] = self.world.agents
        thrust = self._worlds.thrust(torch.cat([agent.dynamics.thrust for agent in agents], dim=1))
        for agent, pushed in zip(agents, thrust.unbind(dim=1), strict=True):
            agent.state.force = pushed[:, None] * heading(agent.state.rot[:, 0])
        drag = _physics().drag
        for entity in self.world.entities:
            entity.state.vel = entity.state.vel + self._worlds.current * drag / (1 - drag)

    def post_step(self) -> None:
        """The reward of the step, and whether the target poses are taken."""
        position = self._positions()
        now = potentials(position, self._target)
        self._goal = reached(position, self._target, self.config.tolerance)
        approach, fine = self._approach - now[0], self._fine - now[1]
        earned = approach + self._goal.float() + self.config.fine_weight * fine
        self._reward = earned - self.config.time_weight
        self._approach, self._fine = now
        self._seen = None
        if self._worlds is not None:
            self._worlds.advance()

    def observation(self, agent: Agent) -> Tensor:
        """What a unit sees (env, feature): worked out for all when the first is asked for."""
        index = self.world.agents.index(agent)
        if self._seen is None or index == 0:
            self._seen = observe(self.config.observation, self.chains())
        return self._seen[:, index]

    def reward(self, agent: Agent) -> Tensor:
        """The chain's reward (env,), the same for every unit."""
        return self._reward

    def done(self) -> Tensor:
        """Whether the target pose is taken, or the fence is touched (env,)."""
        if self._fence is None:
            return self._goal
        return self._goal | (self._positions().abs() >= self._fence).any(dim=-1).any(dim=-1)

    def info(self, agent: Agent) -> dict[str, Tensor]:
        """`goal` and `closed_fraction`, (env, 1)."""
        closed = 1 - self._approach / self._start
        return {"goal": self._goal.float()[:, None], "closed_fraction": closed[:, None]}

    def chains(self) -> Chains:
        """All units as they are now, as far as their sensors tell."""
        states: list[Any] = [agent.state for agent in self.world.agents]
        chains = Chains(
            position=self._positions(),
            angle=torch.cat([state.rot for state in states], dim=1),
            velocity=torch.stack([state.vel for state in states], dim=1),
            angular_velocity=torch.cat([state.ang_vel for state in states], dim=1),
            target=self._target,
            force=torch.stack([state.force for state in states], dim=1),
        )
        return chains if self._worlds is None else self._worlds.told(chains)

    def _positions(self) -> Tensor:
        places: list[Any] = [agent.state.pos for agent in self.world.agents]
        return torch.stack(places, dim=1)

    def extra_render(self, env_index: int = 0) -> list[Any]:
        """The target points, in VMAS's own renderer."""
        from vmas.simulator import rendering

        geometries = []
        for point in self._target[env_index]:
            circle: Any = rendering.make_circle(LINK / 4)  # pyright: ignore[reportArgumentType]
            place = rendering.Transform()
            place.set_translation(*point)
            circle.add_attr(place)
            circle.set_color(*TARGET_COLOUR)
            geometries.append(circle)
        return geometries


def _physics() -> Any:
    """The constants, all plain numbers."""
    return Physics()


def _world(batch_dim: int, device: Any, fence: Any) -> World:
    physics = _physics()
    return World(
        batch_dim,
        device,
        dt=physics.control_step,
        substeps=physics.substeps,
        drag=physics.drag,
        joint_force=physics.joint_stiffness,
        torque_constraint_force=physics.angle_stiffness,
        collision_force=physics.contact_stiffness,
        x_semidim=fence,
        y_semidim=fence,
    )


def _unit(index: int, config: TaskConfig) -> Agent:
    physics = _physics()
    size = 1 if config.action == "thrust" else 2
    return Agent(
        name=f"unit_{index}",
        shape=Box(length=physics.unit_length, width=physics.unit_width),
        mass=physics.unit_mass,
        collide=config.contact,
        action_size=size,
        dynamics=Thruster(size),
        color=Color.BLUE,
    )


def _joint(one: Agent, other: Agent) -> Joint:
    """A link that keeps the angle of both its units: they start along it, so that is zero."""
    physics = _physics()
    return Joint(
        one,
        other,
        rotate_a=False,
        rotate_b=False,
        fixed_rotation_a=0.0,
        fixed_rotation_b=0.0,
        dist=physics.link_length,
        mass=physics.link_mass,
    )


class ChainEnvironment(Environment):
    """VMAS's environment, which names what is wrong with an action."""

    def step(self, actions: Any) -> Any:
        """VMAS's step; actions (env, act) of each unit, as a list or by its name.

        Raises:
            InputError: an action is missing, of a wrong shape or type, or not finite; nothing was
                moved.
        """
        names = [agent.name for agent in self.agents]
        if isinstance(actions, dict):
            given = [actions[name] for name in names if name in actions]
        elif isinstance(actions, list | tuple) or getattr(actions, "ndim", 0):
            given = list(actions)
        else:
            raise InputError(f"actions must be a list, or a dict by unit, got {told(actions)}")
        if not len(names) == len(given) == len(actions):
            raise InputError(f"give an action for each of {len(names)} units, got {len(given)}")
        pairs = zip(names, given, strict=True)
        return super().step([self._checked(name, action) for name, action in pairs])

    def _checked(self, name: str, action: Any) -> Tensor:
        try:
            action = torch.as_tensor(action, device=self.device)
        except (TypeError, ValueError, RuntimeError):
            raise InputError(f"the action of {name} must be numbers, got {action!r:.60}") from None
        size = 1 if not self.continuous_actions else self.get_agent_action_size(self.agents[0])
        if action.ndim == 1:
            action = action[:, None]
        if action.shape != (self.num_envs, size):
            expected, got = (self.num_envs, size), tuple(action.shape)
            raise InputError(f"the action of {name} must have shape {expected}, got {got}")
        if self.continuous_actions and not action.is_floating_point():
            raise InputError(f"the action of {name} must be floating point, got {action.dtype}")
        wrong = (~action.isfinite()).any(dim=1).nonzero()
        if len(wrong):
            where = int(wrong[0])
            raise InputError(
                f"the action of environment {where}, {name}, holds {action[where].tolist()}:"
                " actions must be finite; no chain was moved"
            )
        return action


def make_env(
    num_envs: int,
    device: str = "cpu",
    seed: int | None = None,
    world: WorldConfig | str | None = None,
    **settings: Any,
) -> ChainEnvironment:
    """The scenario as VMAS's environment, with the time limit of its settings.

    Actions are clamped to [-1, 1]; `step` gives five values, terminated and truncated apart.
    For TorchRL there is `make_torchrl_env`.

    Raises:
        InputError: an unknown setting, an invalid one, or a world that VMAS cannot have.
    """
    config = reach_alone(task_of(settings))
    return ChainEnvironment(
        Scenario(),
        num_envs=checked_envs(num_envs),
        device=checked_device(device),
        seed=None if seed is None else checked_seed(seed),
        max_steps=config.step_limit,
        clamp_actions=True,
        terminated_truncated=True,
        world=world,
        **settings,
    )


def make_torchrl_env(
    num_envs: int,
    device: Any = "cpu",
    seed: int | None = None,
    max_steps: int | None = None,
    continuous_actions: bool = True,
    world: WorldConfig | str | None = None,
    **settings: Any,
) -> Any:
    """The scenario in TorchRL's `VmasWrapper`, where the time limit truncates.

    VMAS's own count (`max_steps`) would reach TorchRL as `terminated`, and so teach
    that the future is worth nothing at the time limit. So TorchRL counts (`StepCounter`). The limit
    is that of the task's settings, or `max_steps`.

    Raises:
        InputError: an unknown setting, an invalid one, or a world that VMAS cannot have; TorchRL
            is not installed.
    """
    limit = limit_of(task_of(settings), max_steps)
    need("tensordict", "torchrl")
    need("torchrl", "torchrl")
    from torchrl.envs import StepCounter, TransformedEnv
    from torchrl.envs.libs.vmas import VmasWrapper

    env = ChainEnvironment(
        Scenario(),
        num_envs=checked_envs(num_envs),
        device=checked_device(device),
        seed=None if seed is None else checked_seed(seed),
        continuous_actions=continuous_actions,
        clamp_actions=True,
        world=world,
        **settings,
    )
    return TransformedEnv(VmasWrapper(env, categorical_actions=True), StepCounter(limit))
