"""The paper's chain in the real VMAS, for timing: its `World.step` alone, nothing around it."""

import itertools
import statistics
import time

import jax
import numpy as np
import torch
from jaxtyping import Array
from vmas.simulator.core import Agent, Box, World
from vmas.simulator.joints import Joint

from salpchain.physics.state import Chain

LINK = 0.07  # m
REPEATS = 3


def chains(envs: int, length: int) -> World:
    """A world of `envs` straight chains at rest, with the paper's constants."""
    world = World(
        envs, "cpu", dt=0.1, substeps=15,
        joint_force=900, torque_constraint_force=0.1, collision_force=1500,
    )  # fmt: skip
    units = [
        Agent(name=f"unit {i}", shape=Box(length=0.04, width=0.05), mass=1.0, rotatable=True)
        for i in range(length)
    ]
    for unit in units:
        world.add_agent(unit)
    for one, other in itertools.pairwise(units):
        world.add_joint(Joint(one, other, rotate_a=False, rotate_b=False, dist=LINK))
    for i, unit in enumerate(units):
        unit.set_pos(torch.tensor([LINK * i, 0.0]).expand(envs, 2).clone(), batch_index=None)
    return world


def place(world: World, chain: Chain) -> None:
    """Puts the world's chains where these are, and as fast; batch first."""
    for entities, bodies in ((world.agents, chain.units), (world.landmarks, chain.links)):
        rows = [torch.from_numpy(np.array(x)) for x in jax.tree.leaves(bodies)]
        for k, entity in enumerate(entities):
            position, angle, velocity, spin = (row[:, k] for row in rows)
            entity.state.pos, entity.state.vel = position, velocity
            entity.state.rot, entity.state.ang_vel = angle[:, None], spin[:, None]


def push(world: World, thrust: torch.Tensor) -> None:
    """Thrusts (batch, unit) across each unit."""
    for k, unit in enumerate(world.agents):
        turn = unit.state.rot
        across = torch.cat([-torch.sin(turn), torch.cos(turn)], dim=-1)
        unit.state.force = thrust[:, k, None] * across


def random_push(world: World, generator: torch.Generator) -> None:
    """Random thrust across each unit."""
    size = len(world.agents[0].state.pos), len(world.agents)
    push(world, 2 * torch.rand(size, generator=generator) - 1)


def steps_per_second_from(chain: Chain, thrust: Array, steps: int) -> float:
    """Chain-steps per second from these chains under a thrust that is held, whose making is not
    counted; the median of several runs."""
    world = chains(*thrust.shape)
    held = torch.from_numpy(np.array(thrust))
    rates = []
    for _ in range(REPEATS):
        place(world, chain)
        spent = 0.0
        for _ in range(steps):
            push(world, held)
            started = time.perf_counter()
            world.step()
            spent += time.perf_counter() - started
        rates.append(len(thrust) * steps / spent)
    return statistics.median(rates)


def steps_per_second(envs: int, length: int, seconds: float = 1.0) -> float:
    """Chain-steps per second: the median of several runs, the thrust's making not counted."""
    world, generator = chains(envs, length), torch.Generator().manual_seed(0)
    random_push(world, generator)
    world.step()
    rates = []
    for _ in range(REPEATS):
        spent, steps = 0.0, 0
        while spent < seconds:
            random_push(world, generator)
            started = time.perf_counter()
            world.step()
            spent += time.perf_counter() - started
            steps += 1
        rates.append(envs * steps / spent)
    return statistics.median(rates)
