"""The task in torch, for batches of whole chains: spawn, target, observation, Frechet distance.

The same numbers as `salpchain.tasks` gives; arrays are (env, unit, ...). For those who stay in
torch, such as the VMAS scenario.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from salpchain.interop.extras import need
from salpchain.tasks.observations import SENSED
from salpchain.tasks.reach.reward import FINE_SCALE
from salpchain.tasks.reach.targets import LINK, RADIUS, SPAWN

need("torch", "vmas")

import torch
from torch import Tensor

Device = torch.device | str


@dataclass(frozen=True)
class Chains:
    """Units of a batch of chains, and what they must do."""

    position: Tensor  # (env, unit, 2) m, world
    angle: Tensor  # (env, unit) rad
    velocity: Tensor  # (env, unit, 2) m/s
    angular_velocity: Tensor  # (env, unit) rad/s
    target: Tensor  # (env, unit, 2) m
    force: Tensor  # (env, unit, 2) N, of each thrust in the last control step, world axes


def heading(angle: Tensor) -> Tensor:
    """Unit vectors (..., 2) in which a positive thrust pushes: the angle + 90 degrees."""
    return torch.stack([-torch.sin(angle), torch.cos(angle)], dim=-1)


def spawn(envs: int, length: int, device: Device) -> tuple[Tensor, Tensor]:
    """Random starts: positions (env, unit, 2) m of straight chains, and their angle (env,) rad."""
    first = (torch.rand(envs, 1, 2, device=device) * 2 - 1) * SPAWN
    angle = torch.rand(envs, device=device) * 2 * math.pi
    along = LINK * torch.stack([torch.cos(angle), torch.sin(angle)], dim=-1)
    return first + torch.arange(length, device=device)[:, None] * along[:, None], angle


def target_pose(envs: int, length: int, device: Device) -> Tensor:
    """Random target poses (env, unit, 2) m: one or two arcs, placed as the paper does."""
    u = torch.rand(8, envs, device=device)
    first = torch.where(u[:2] < 0.5, -1.0, 1.0) * (1 + u[2:4]) * length * LINK
    radius = (RADIUS[0] + (RADIUS[1] - RADIUS[0]) * u[4]) * max(1, length // 3)
    left, double = torch.where(u[5] < 0.5, -1.0, 1.0), u[6] < 0.5
    return first.T[:, None] + curve(radius, left, double, u[7] * 2 * math.pi, length)


def curve(radius: Tensor, left: Tensor, double: Tensor, turn: Tensor, length: int) -> Tensor:
    """Points (env, unit, 2) m one link apart on arcs, the first at the origin (see `targets`)."""
    second = torch.arange(length - 1, device=radius.device) >= (length + 1) // 2
    side = torch.where(second & double[:, None], -1.0, 1.0)
    step = 2 * torch.arcsin(torch.clamp(LINK / (2 * radius), max=1.0))
    angle = turn[:, None] + (left * step)[:, None] * (side.cumsum(dim=1) - side[:, :1])
    chords = LINK * torch.stack([torch.cos(angle), torch.sin(angle)], dim=-1)
    return torch.cat([torch.zeros_like(chords[:, :1]), chords.cumsum(dim=1)], dim=1)


def frechet_distance(one: Tensor, other: Tensor) -> Tensor:
    """Discrete Frechet distances (env,) m of chains of points (env, point, 2).

    The coupling table is filled one antidiagonal at a time, for all environments at once.
    """
    num = one.shape[1]
    apart = torch.linalg.vector_norm(one[:, :, None] - other[:, None], dim=-1)
    rows = torch.arange(num, device=one.device)
    endless = torch.full_like(apart[:, :1, 0], math.inf)
    before = previous = torch.full_like(apart[:, :, 0], math.inf)
    for k in range(2 * num - 1):
        column = k - rows
        there = (column >= 0) & (column < num)
        entry = apart[:, rows, column.clamp(0, num - 1)]
        if k:
            shifted = torch.cat([endless, previous[:, :-1]], dim=1)
            diagonal = torch.cat([endless, before[:, :-1]], dim=1)
            reached = torch.minimum(torch.minimum(previous, shifted), diagonal)
            entry = torch.maximum(entry, reached)
        before, previous = previous, torch.where(there, entry, math.inf)
    return previous[:, -1]


def reached(position: Tensor, target: Tensor, tolerance: float) -> Tensor:
    """Whether chains have taken their target poses (env,); the table is filled only in doubt."""
    apart = torch.linalg.vector_norm(position - target, dim=-1)
    certain = (apart <= tolerance).all(dim=1)
    doubtful = (apart[:, 0] <= tolerance) & (apart[:, -1] <= tolerance) & ~certain
    if doubtful.any():
        certain[doubtful] = frechet_distance(position[doubtful], target[doubtful]) <= tolerance
    return certain


def potentials(position: Tensor, target: Tensor) -> tuple[Tensor, Tensor]:
    """Mean distance (env,) m to the target, and its log-compressed counterpart (see `reward`)."""
    square = ((target - position) ** 2).sum(dim=-1)
    apart = square.sqrt()
    together = torch.log1p(square.mean(dim=1).sqrt() / FINE_SCALE)
    return apart.mean(dim=1), (torch.log1p(apart / FINE_SCALE).mean(dim=1) + together) / 2


def observe(name: str, chains: Chains) -> Tensor:
    """What every unit sees (env, unit, feature); `name` as in `TaskConfig.observation`."""
    return OBSERVATIONS[name](chains)


def body(chains: Chains, metric: bool = False) -> Tensor:
    """The unit's own view, 22 numbers (see `observations`)."""
    length = chains.angle.shape[1]
    error = chains.target - chains.position
    here = chains.position.mean(dim=1, keepdim=True)
    beside = chains.position - here
    spread = (beside**2).sum(dim=-1).mean(dim=1).sqrt()[:, None, None]
    mean_velocity = chains.velocity.mean(dim=1, keepdim=True).expand_as(error)
    far = chains.target.mean(dim=1, keepdim=True) - here
    vectors = [
        chains.velocity * 5,
        *(v / LINK for points in (chains.position, chains.target) for v in _towards(points)),
        error / (torch.linalg.vector_norm(error, dim=-1, keepdim=True) + 0.01),
        mean_velocity * 5,
        beside / (spread + 0.01),
    ]
    seen = [_own(chains.angle, v) for v in (error, far.expand_as(error))]
    place = torch.linspace(-1, 1, length, device=error.device).expand_as(chains.angle)
    return torch.cat(
        [
            *(_own(chains.angle, v) for v in vectors),
            *(v if metric else _compress(v) for v in seen),
            chains.angular_velocity[..., None] / 3,
            place[..., None],
        ],
        dim=-1,
    )


def table1(chains: Chains) -> Tensor:
    """The paper's Table 1, 24 numbers (see `observations`)."""
    position, velocity, angle = chains.position, chains.velocity, chains.angle
    index = torch.arange(angle.shape[1], device=angle.device)
    bits = torch.stack([(index >> bit) & 1 for bit in range(4)], dim=-1)
    none = torch.zeros_like(chains.force[:, :1])
    return torch.cat(
        [
            bits.to(angle.dtype).expand(*angle.shape, 4),
            position,
            velocity,
            _wrap(angle)[..., None],
            chains.angular_velocity[..., None],
            velocity - velocity.mean(dim=1, keepdim=True),
            position - position.mean(dim=1, keepdim=True),
            position - chains.target.mean(dim=1, keepdim=True),
            chains.target - position,
            *(_bearing(angle, vector) for vector in _towards(position)),
            torch.cat([none, chains.force[:, :-1]], dim=1),
            torch.cat([chains.force[:, 1:], none], dim=1),
        ],
        dim=-1,
    )


def proximity(chains: Chains, metric: bool = False) -> Tensor:
    """`body`, and the nearest unit that is no neighbour (see `observations`)."""
    position, length = chains.position, chains.angle.shape[1]
    slot = torch.arange(length, device=position.device)
    offset = position[:, None] - position[:, :, None]
    apart = torch.linalg.vector_norm(offset, dim=-1)
    apart = torch.where((slot[:, None] - slot).abs() > 1, apart, math.inf)
    least = apart.amin(dim=2, keepdim=True)
    chosen = (apart == least) & torch.isfinite(apart)
    share = (1 / least.clamp(min=1e-6) - 1 / SENSED).clamp(min=0)
    share = share / chosen.sum(dim=2, keepdim=True).clamp(min=1)
    vector = 2 * share * (chosen[..., None] * offset).sum(dim=2)
    return torch.cat([body(chains, metric), _own(chains.angle, vector)], dim=-1)


def anonymous(chains: Chains) -> Tensor:
    """`proximity` without the unit's place in the chain."""
    seen = proximity(chains)
    return torch.cat([seen[..., :-3], seen[..., -2:]], dim=-1)


OBSERVATIONS: dict[str, Callable[[Chains], Tensor]] = {
    "body": body,
    "table1": table1,
    "proximity": proximity,
    "anonymous": anonymous,
    "metric": partial(proximity, metric=True),
}


def _own(angle: Tensor, vector: Tensor) -> Tensor:
    """World vectors in each unit's axes: along the unit, and along its heading."""
    cosine, sine = torch.cos(angle), torch.sin(angle)
    x, y = vector.unbind(dim=-1)
    return torch.stack([cosine * x + sine * y, cosine * y - sine * x], dim=-1)


def _compress(x: Tensor) -> Tensor:
    return torch.sign(x) * torch.log1p(5 * torch.abs(x))


def _towards(points: Tensor) -> tuple[Tensor, Tensor]:
    """From each point to the previous and to the next; zero where there is none."""
    step = points[:, 1:] - points[:, :-1]
    none = torch.zeros_like(points[:, :1])
    return torch.cat([none, -step], dim=1), torch.cat([step, none], dim=1)


def _bearing(angle: Tensor, vector: Tensor) -> Tensor:
    x, y = vector.unbind(dim=-1)
    there = (x != 0) | (y != 0)
    return torch.where(there, _wrap(torch.atan2(y, x) - angle), 0.0)[..., None]


def _wrap(angle: Tensor) -> Tensor:
    return torch.remainder(angle + math.pi, 2 * math.pi) - math.pi
