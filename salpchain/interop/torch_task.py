"""The task in torch, for batches of whole chains: spawn, target, observation, Frechet distance.

The same numbers as `salpchain.tasks` gives; arrays are (env, unit, ...). For those who stay in
torch, such as the VMAS scenario.
"""

import math
from dataclasses import dataclass

from salpchain.errors import InputError
from salpchain.interop.extras import need
from salpchain.tasks.features import OBSERVATIONS, SENSED, features, readings, senses
from salpchain.tasks.reach.reward import FINE_SCALE
from salpchain.tasks.reach.targets import LINK, RADIUS, SPAWN
from salpchain.tasks.view import View

need("torch", "vmas")

import torch
from torch import Tensor

Device = torch.device | str
Pair = tuple[Tensor, Tensor]  # x and y, (env, unit) or (env, 1) each


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
    """What every unit sees (env, unit, feature); `name` as in `TaskConfig.observation`.

    Raises:
        InputError: an observation of what is around a chain, which VMAS's world does not give, or
            of several control steps.
    """
    if readings(name)[1] > 1:
        raise InputError(
            f"observation {name} is of several control steps at once, which VMAS does not keep:"
            f" choose {readings(name)[0]}"
        )
    if senses(name):
        raise InputError(
            f"observation {name} senses {', '.join(senses(name))}, which there is not in VMAS:"
            f" choose one of {', '.join(n for n in OBSERVATIONS if not senses(n))}"
        )
    view, like = TorchView(chains), chains.angle
    rows = [row for feature in features(name) for row in feature.rows(view)]
    return torch.stack([row.expand_as(like) for row in rows], dim=-1)


class TorchView(View):
    """A batch of chains as rows (env, unit); `View` says what each is."""

    def __init__(self, chains: Chains) -> None:
        """Rows of whole chains, all of one length."""
        self.position, self.velocity = _pair(chains.position), _pair(chains.velocity)
        self.target, self.force = _pair(chains.target), _pair(chains.force)
        self.angle, self.angular_velocity = chains.angle, chains.angular_velocity
        self.turn = torch.cos(chains.angle), torch.sin(chains.angle)
        self.sensed = {}

    @property
    def centroid(self) -> Pair:
        """Mean position of the chain's units (m)."""
        return self.mean(self.position)

    @property
    def target_centroid(self) -> Pair:
        """Mean of the target points (m)."""
        return self.mean(self.target)

    def mean(self, pair: Pair) -> Pair:
        """Mean over the units."""
        return pair[0].mean(dim=1, keepdim=True), pair[1].mean(dim=1, keepdim=True)

    def own(self, pair: Pair) -> Pair:
        """World vectors in each unit's axes: along the unit, and along its heading."""
        (cosine, sine), (x, y) = self.turn, pair
        return cosine * x + sine * y, cosine * y - sine * x

    def neighbours(self, row: Tensor) -> tuple[Tensor, Tensor]:
        """What the previous and what the next unit has; zero where there is none."""
        none = torch.zeros_like(row[:, :1])
        return torch.cat([none, row[:, :-1]], dim=1), torch.cat([row[:, 1:], none], dim=1)

    def towards(self, pair: Pair) -> tuple[Pair, Pair]:
        """From each unit's point to those of the previous and next unit; else zero."""
        steps = [row[:, 1:] - row[:, :-1] for row in pair]
        none = torch.zeros_like(pair[0][:, :1])
        previous = [torch.cat([none, -step], dim=1) for step in steps]
        following = [torch.cat([step, none], dim=1) for step in steps]
        return (previous[0], previous[1]), (following[0], following[1])

    def nearest(self) -> Pair:
        """To the nearest unit that is no neighbour, 1 - distance / `SENSED` long."""
        slot = torch.arange(self.angle.shape[1], device=self.angle.device)
        x, y = (row[:, None] - row[:, :, None] for row in self.position)
        apart = (x**2 + y**2).sqrt()
        apart = torch.where((slot[:, None] - slot).abs() > 1, apart, math.inf)
        least = apart.amin(dim=2, keepdim=True)
        chosen = (apart == least) & torch.isfinite(apart)
        share = (1 / least.clamp(min=1e-6) - 1 / SENSED).clamp(min=0)[..., 0]
        share = share / chosen.sum(dim=2).clamp(min=1)
        return share * (chosen * x).sum(dim=2), share * (chosen * y).sum(dim=2)

    def bearing(self, vector: Pair) -> Tensor:
        """Angle of a vector from the unit's own angle (rad, wrapped); 0 of no vector."""
        x, y = vector
        there = (x != 0) | (y != 0)
        return torch.where(there, self.wrap(torch.atan2(y, x) - self.angle), 0.0)

    def bit(self, place: int) -> Tensor:
        """A bit of the unit's index in the chain."""
        index = torch.arange(self.angle.shape[1], device=self.angle.device)
        return ((index >> place) & 1).to(self.angle.dtype)

    def place(self) -> Tensor:
        """Place in the chain, from -1 (first) to 1 (last)."""
        return torch.linspace(-1, 1, self.angle.shape[1], device=self.angle.device)

    def wrap(self, angle: Tensor) -> Tensor:
        """An angle (rad) in [-pi, pi)."""
        return torch.remainder(angle + math.pi, 2 * math.pi) - math.pi

    def root(self, row: Tensor) -> Tensor:
        """The square root."""
        return torch.sqrt(row)

    def compress(self, row: Tensor) -> Tensor:
        """sign(x) log(1 + 5 |x|)."""
        return torch.sign(row) * torch.log1p(5 * torch.abs(row))


def _pair(vectors: Tensor) -> Pair:
    return vectors[..., 0], vectors[..., 1]
