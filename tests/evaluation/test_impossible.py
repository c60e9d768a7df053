"""What is said where physics, and not the controller, stands in the way of the target."""

import dataclasses
import inspect
from importlib import import_module

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import salpchain
from salpchain import Greedy
from salpchain.cli.main import COMMANDS
from salpchain.controllers.policy import PolicyCard
from salpchain.evaluation.difficulty import start_of
from salpchain.evaluation.impossible import of_summary, of_swims, of_water, reachable_in
from salpchain.evaluation.starts import domain_for, start_keys
from salpchain.interop.checks import task_of
from salpchain.ranges import as_range
from salpchain.tasks.config import TaskConfig
from salpchain.world.config import CurrentConfig, WorldConfig
from salpchain.world.presets import WORLDS
from tests.report.swims import made


def test_whatever_plays_a_policy_gives_it_the_scaled_limit_and_training_the_papers():
    limits = {}
    for command, (kind, _) in COMMANDS.items():
        options = getattr(import_module(f"salpchain.cli.{command}"), kind)
        defaults = {field.name: field.default for field in dataclasses.fields(options)}
        limits |= {command: defaults["time_limit"]} if "time_limit" in defaults else {}
    for name in salpchain.__all__:
        public = getattr(salpchain, name)
        if inspect.isfunction(public) and "time_limit" in inspect.signature(public).parameters:
            limits[name] = inspect.signature(public).parameters["time_limit"].default
    assert limits.keys() >= {"evaluate", "rollout", "video", "replay", "record"}
    assert set(limits.values()) == {"scaled"}
    assert PolicyCard().task(64).step_limit == task_of({"length": 64}).step_limit == 2048
    assert PolicyCard().task(64, time_limit="fixed").time_limit == "fixed"
    assert task_of({"time_limit": "fixed"}) == TaskConfig()  # what a training takes


def start(length, trial=0):
    """The first moment of an episode under the paper's limit, and its physical limit."""
    env = domain_for([Greedy()], length, "fixed")
    state = jax.jit(env.reset)(start_keys(0, length, jnp.array([trial]))[0], length)
    units, links = state.chain.units, state.chain.links
    swim = made(units.position[None, :length], units.angle[None, :length], state.target[:length])
    swim = dataclasses.replace(
        swim, success=False, link_position=np.asarray(links.position[None, : length - 1])
    )
    return swim, float(start_of(env, state).reachable)


@pytest.fixture(scope="module")
def short():
    """A start whose target is too far away for 512 steps, and one at hand."""
    return [start(64)[0], start(2)[0]]


@pytest.mark.parametrize(("length", "trial"), [(64, 0), (64, 1), (128, 2), (3, 0)])
def test_the_limit_of_a_swim_is_that_of_its_trial(length, trial):
    swim, reachable = start(length, trial)
    assert reachable_in(swim) == pytest.approx(reachable, abs=1e-5)
    assert (reachable < 1) == ((length, trial) in [(64, 0), (128, 2)])


def test_swims_that_no_controller_could_finish_are_told_in_one_line(short):
    line = of_swims(short)
    percent = f"{100 * reachable_in(short[0]):.1f} %"
    assert line.startswith("512 steps are too short at 64 units: no controller can close more")
    assert percent in line and "--time-limit scaled" in line and "\n" not in line
    there = dataclasses.replace(short[0], success=True)
    scaled = dataclasses.replace(short[0], time_limit="scaled")
    assert of_swims([there, scaled, short[1]]) == of_swims([]) == ""


def rows(*reachable):
    return [{"length": 8 * n, "reachable": {"mean": x}} for n, x in enumerate(reachable, 1)]


@pytest.mark.parametrize(
    ("reachable", "says"),
    [
        ((1.0, 1.0, 0.99951), ""),
        ((1.0, 1.0, 0.9), "at 24 units: no controller can close more than 90.0 % on average"),
        ((1.0, 0.98, 0.9, 0.8), "at 16 to 32 units: no controller can close more than 80.0 to 98"),
        ((0.9, 1.0, 0.9, 0.9), "at 8, 24, 32 units"),
    ],
)
def test_an_evaluation_says_at_which_lengths_its_limit_is_too_short(reachable, says):
    summary = {"time_limit": "fixed", "lengths": rows(*reachable)}
    assert says in of_summary(summary) and bool(says) == bool(of_summary(summary))
    assert of_summary({**summary, "time_limit": "scaled"}) == ""


def test_in_our_own_worlds_every_chain_can_hold_its_target():
    assert [name for name, world in WORLDS.items() if of_water(world, [2, 512])] == []


@pytest.mark.parametrize(
    ("current", "told"),
    [
        ({"speed": "0:0.5"}, "may flow at 0.50 m/s, 64 units swim at 0.1"),
        ({"vortex": 0.15, "speed": 0.15}, "may flow at 0.30 m/s, 64 units"),
        ({"wander": 0.1}, "may flow at 0.30 m/s, 64 units"),
        ({"speed": 0.1}, ""),
    ],
)
def test_water_that_is_too_fast_is_named_with_the_slowest_chain(current, told):
    kinds = {name: as_range(value) for name, value in current.items()}
    line = of_water(WorldConfig(current=CurrentConfig(**kinds)), [8, 64, 4])
    assert told in line and bool(line) == bool(told) and "\n" not in line
