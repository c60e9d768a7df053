"""The paper's chain in the real VMAS, for timing: its `World.step` alone, nothing around it."""

import itertools
import statistics
import time

import torch
from vmas.simulator.core import Agent, Box, World
from vmas.simulator.joints import Joint

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


def push(world: World, generator: torch.Generator) -> None:
    """Random thrust across each unit."""
    for unit in world.agents:
        thrust = 2 * torch.rand(unit.state.pos.shape[0], 1, generator=generator) - 1
        turn = unit.state.rot
        unit.state.force = thrust * torch.cat([-torch.sin(turn), torch.cos(turn)], dim=-1)


def steps_per_second(envs: int, length: int, seconds: float = 1.0) -> float:
    """Chain-steps per second: the median of several runs, the thrust's making not counted."""
    world, generator = chains(envs, length), torch.Generator().manual_seed(0)
    push(world, generator)
    world.step()
    rates = []
    for _ in range(REPEATS):
        spent, steps = 0.0, 0
        while spent < seconds:
            push(world, generator)
            started = time.perf_counter()
            world.step()
            spent += time.perf_counter() - started
            steps += 1
        rates.append(envs * steps / spent)
    return statistics.median(rates)
