"""One of several worlds is the world that it is by itself; an episode may be spared some of it."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

from salpchain.ranges import Range
from salpchain.world.among import chosen
from salpchain.world.config import CurrentConfig, DynamicsConfig, ThrusterConfig, WorldConfig
from salpchain.world.presets import WORLDS, world_config
from salpchain.world.randomise import draw_world

NAMES = ["still", "current", "vortex", "failing", "noisy", "rough", "sea"]
MANY = [replace(WORLDS[name], spared=Range(0.0, 0.0)) for name in NAMES]
PLACE = jnp.array([[0.1, -0.2], [0.3, 0.4]])


@pytest.fixture(scope="module")
def draw():
    def drawn(which, key):
        return eqx.filter(draw_world(chosen(MANY, which), key, 8, 6, 300), eqx.is_array)

    return jax.jit(drawn)


@pytest.mark.parametrize("which", range(len(NAMES)))
def test_the_chosen_world_is_drawn_as_it_is_alone(draw, which):
    key = jr.key(which)
    among, alone = draw(which, key), draw_world(MANY[which], key, 8, 6, 300)
    for name in ("drag", "unit_mass", "angle_stiffness"):
        one, other = (getattr(world.dynamics, name) for world in (among, alone))
        assert float(one) == pytest.approx(float(other))
    still = np.zeros((2, 2))
    flow = still if alone.current is None else alone.current.flow(PLACE).velocity
    np.testing.assert_allclose(among.current.flow(PLACE).velocity, flow, rtol=1e-5, atol=1e-8)
    asked, before = jnp.linspace(-1, 1, 8), jnp.linspace(0.5, 0, 8)
    thrust = [
        asked if world.thrusters is None else world.thrusters.thrust(asked, before, time, 0.1)
        for time in (jnp.int32(0), jnp.int32(299))
        for world in (among, alone)
    ]
    np.testing.assert_allclose(thrust[0], thrust[1], atol=1e-6)
    np.testing.assert_allclose(thrust[2], thrust[3], atol=1e-6)
    if alone.sensing is not None:
        for name, value in vars(among.sensing).items():
            if isinstance(value, jax.Array):  # of each episode
                assert float(value) == pytest.approx(float(getattr(alone.sensing, name))), name
    else:
        faults = ("position", "angle", "stuck", "dropped", "delay", "action_delay")
        assert not any(float(getattr(among.sensing, name)) for name in faults)


def test_worlds_that_need_programs_of_their_own_are_refused():
    fine = WorldConfig(dynamics=DynamicsConfig(substeps=2))
    with pytest.raises(ValueError, match=r"agree in world\.dynamics\.substeps, got 1 in one"):
        chosen([WorldConfig(), fine], 0)
    assert draw_world(fine, jr.key(0), 4, 4, 10).dynamics.substeps == 30


SPARED = WorldConfig(
    dynamics=DynamicsConfig(mass=Range(1.5, 1.5), drag=Range(2.0, 2.0)),
    current=CurrentConfig(speed=Range(0.05, 0.05)),
    thrusters=ThrusterConfig(dead=Range(0.5, 0.5), one_sided=True),
    spared=Range(0.25, 0.25),
)


def test_each_setting_is_spared_by_itself_as_often_as_it_says():
    draw = jax.jit(jax.vmap(lambda key: eqx.filter(draw_world(SPARED, key, 4, 4, 9), eqx.is_array)))
    worlds = draw(jr.split(jr.key(0), 3000))
    speed = jnp.linalg.norm(worlds.current.velocity, axis=1)
    given = np.stack([
        np.isclose(worlds.dynamics.unit_mass, 1.5), np.isclose(worlds.dynamics.drag, 0.5),
        np.isclose(speed, 0.05), (worlds.thrusters.gain == 0).sum(axis=1) == 2,
        worlds.thrusters.one_sided,
    ])  # fmt: skip
    plain = np.stack([
        np.isclose(worlds.dynamics.unit_mass, 1.0), np.isclose(worlds.dynamics.drag, 0.25),
        np.isclose(speed, 0.0), (worlds.thrusters.gain == 0).sum(axis=1) == 0,
        ~worlds.thrusters.one_sided,
    ])  # fmt: skip
    np.testing.assert_array_equal(given, ~plain)
    np.testing.assert_allclose(given.mean(axis=1), 0.75, atol=0.03)
    assert np.abs(np.corrcoef(given) - np.eye(5)).max() < 0.08


def test_a_spared_range_gives_episodes_of_one_trouble_and_of_all():
    keys = jr.split(jr.key(1), 2000)
    world = replace(SPARED, spared=Range(0.0, 1.0))
    draw = jax.jit(jax.vmap(lambda key: eqx.filter(draw_world(world, key, 4, 4, 9), eqx.is_array)))
    drawn = draw(keys)
    number = np.isclose(drawn.dynamics.unit_mass, 1.5).astype(int)
    number += np.isclose(drawn.dynamics.drag, 0.5)
    number += np.asarray(jnp.linalg.norm(drawn.current.velocity, axis=1) > 0)
    number += np.asarray(drawn.thrusters.one_sided)
    shares = np.bincount(number, minlength=5) / len(keys)
    np.testing.assert_allclose(shares, 0.2, atol=0.04)  # any number of four as often


@pytest.mark.parametrize("spared", [0.0, 0.9])
def test_one_sided_jets_may_have_a_share_of_the_episodes_that_nothing_is_spared(spared):
    jets = ThrusterConfig(dead=Range(0.5, 0.5), one_sided=True, one_sided_share=0.3)
    world = WorldConfig(thrusters=jets, spared=Range(spared, spared))
    draw = jax.jit(jax.vmap(lambda key: eqx.filter(draw_world(world, key, 4, 4, 9), eqx.is_array)))
    drawn = draw(jr.split(jr.key(2), 3000)).thrusters
    shares = np.mean(drawn.one_sided), np.mean((drawn.gain == 0).any(axis=1))
    np.testing.assert_allclose(shares, (0.3, 1 - spared), atol=0.03)


def test_a_world_that_is_spared_nothing_is_what_it_was_and_sea_is_spared_some():
    assert not SPARED.is_still and WorldConfig(spared=Range(0.0, 1.0)).is_still
    assert world_config("sea").spared == Range(0.0, 1.0)
    assert WORLDS["sea"].changes(WorldConfig())["spared"] == Range(0.0, 1.0)
