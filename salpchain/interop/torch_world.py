"""Worlds in torch, for the VMAS scenario: currents, thrusters and noise, drawn for each episode.

The same distributions as `salpchain.world.randomise`; arrays are (env, ...).
"""

from dataclasses import replace
from typing import Any

from salpchain.errors import InputError
from salpchain.given import told
from salpchain.interop.extras import need
from salpchain.interop.torch_task import Chains
from salpchain.ranges import Range
from salpchain.tasks.features import CONTROL_STEP
from salpchain.world.config import WorldConfig
from salpchain.world.presets import WORLDS, world_config

need("torch", "vmas")

import torch
from torch import Tensor

CAN = ("current.speed", "current.wander", "current.relaxation")
CAN += tuple(f"thrusters.{name}" for name in ("dead", "failing", "gain", "lag", "one_sided"))
CAN += tuple(f"sensing.{name}" for name in ("position", "angle", "position_bias", "angle_bias"))
READINGS = 6  # of a unit: position (2), angle, velocity (2), angular velocity
NEVER = torch.iinfo(torch.int64).max

Device = torch.device | str


def vmas_world(world: Any) -> WorldConfig:
    """The settings of a world that VMAS can have, of them or of a name; None is still water.

    Raises:
        InputError: another kind of world, an unknown name, or what VMAS's physics cannot do.
    """
    if world is None or isinstance(world, str):
        world = world_config(world or "still")
    if not isinstance(world, WorldConfig):
        known = f"a WorldConfig or one of {', '.join(WORLDS)}"
        raise InputError(f"in VMAS world must be {known}, got {told(world)}")
    wrong = [path for path in world.changes(WorldConfig()) if path not in CAN]
    if wrong:
        raise InputError(
            f"VMAS has its own physics, without {', '.join(wrong)}: its worlds have currents"
            " (speed, wander), thrusters, noise and bias of positions and angles"
        )
    return world


class Worlds:
    """The worlds of a batch of chains; each draws its own at the start of an episode."""

    def __init__(
        self, config: WorldConfig, envs: int, length: int, steps: int, device: Device
    ) -> None:
        """For `envs` chains of `length` units, and episodes of at most so many `steps`."""
        self._config, self._steps = config, steps

        def zeros(*shape: int) -> Tensor:
            return torch.zeros(envs, *shape, device=device)

        self._time = torch.zeros(envs, 1, dtype=torch.int64, device=device)  # control steps
        self._steady, self._change = zeros(2), zeros(2)  # m/s
        self._deviation, self._relaxation = zeros(1), zeros(1) + 1
        self._gain, self._thrust, self._lag = zeros(length), zeros(length), zeros(1)
        self._fails_at = torch.full((envs, length), NEVER, device=device)
        self._scale, self._bias_scale = zeros(1, READINGS), zeros(1, READINGS)
        self._bias, self._noise = zeros(length, READINGS), zeros(length, READINGS)

    def draw(self, rows: slice) -> None:
        """New worlds for the new episodes of these chains; those of others stay as they are."""
        self._time[rows], self._thrust[rows] = 0, 0.0
        self._draw_current(rows)
        self._draw_thrusters(rows)
        self._draw_sensing(rows)

    def _draw_current(self, rows: slice) -> None:
        config, like = self._config.current, self._deviation[rows]
        angle = 2 * torch.pi * torch.rand_like(like)
        direction = torch.cat([torch.cos(angle), torch.sin(angle)], dim=1)
        self._steady[rows] = _drawn(config.speed, like) * direction
        self._deviation[rows] = _drawn(config.wander, like)
        self._relaxation[rows] = _drawn(config.relaxation, like)
        self._change[rows] = self._deviation[rows] * torch.randn_like(direction)

    def _draw_thrusters(self, rows: slice) -> None:
        config, like = self._config.thrusters, self._gain[rows]
        length, each = like.shape[1], like[:, :1]
        rank = torch.rand_like(like).argsort(dim=1).argsort(dim=1)
        dead = (_drawn(config.dead, each) * length).round()
        failing = (_drawn(config.failing, each) * length).round()
        fails = (rank >= dead) & (rank < dead + failing)
        self._gain[rows] = torch.where(rank < dead, 0.0, _drawn(config.gain, like))
        at = (self._steps * torch.rand_like(like)).long()
        self._fails_at[rows] = torch.where(fails, at, NEVER)
        self._lag[rows] = _drawn(config.lag, each)

    def _draw_sensing(self, rows: slice) -> None:
        config, like = self._config.sensing, self._lag[rows]
        place, turn = _drawn(config.position, like), _drawn(config.angle, like)
        self._scale[rows, 0] = torch.cat([place, place, turn, place, place, turn], dim=1)
        place, turn = _drawn(config.position_bias, like), _drawn(config.angle_bias, like)
        still = torch.zeros_like(like)
        self._bias_scale[rows, 0] = torch.cat([place, place, turn, still, still, still], dim=1)
        self._bias[rows] = self._bias_scale[rows] * torch.randn_like(self._bias[rows])
        self._noise[rows] = self._scale[rows] * torch.randn_like(self._noise[rows])

    @property
    def current(self) -> Tensor:
        """The velocity of the water (env, 2) m/s, the same everywhere."""
        return self._steady + self._change

    def thrust(self, asked: Tensor) -> Tensor:
        """The thrusts (env, unit) N of this control step, of those asked for."""
        if self._config.thrusters.one_sided:
            asked = asked.clamp(min=0.0)
        thrust = torch.where(self._time < self._fails_at, self._gain, 0.0) * asked
        keep = torch.exp(-CONTROL_STEP / self._lag.clamp(min=1e-6))
        self._thrust = thrust + keep * (self._thrust - thrust)
        return self._thrust

    def advance(self) -> None:
        """One control step later: the water has changed, and there are new readings."""
        keep = torch.exp(-CONTROL_STEP / self._relaxation)
        drawn = self._deviation * (1 - keep**2).sqrt() * torch.randn_like(self._change)
        self._change = keep * self._change + drawn
        self._noise = self._scale * torch.randn_like(self._noise)
        self._time += 1

    def told(self, chains: Chains) -> Chains:
        """The chains as their sensors tell of them."""
        error = self._bias + self._noise
        return replace(
            chains,
            position=chains.position + error[..., :2],
            angle=chains.angle + error[..., 2],
            velocity=chains.velocity + error[..., 3:5],
            angular_velocity=chains.angular_velocity + error[..., 5],
        )


def _drawn(given: Range, like: Tensor) -> Tensor:
    """Numbers of the range, uniform, in the shape of a tensor."""
    if given.is_fixed:
        return torch.full_like(like, given.low)
    return given.low + (given.high - given.low) * torch.rand_like(like)
