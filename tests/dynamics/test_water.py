"""The chain in water: its limits, its energy, its jets."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from salpchain.dynamics.landsalp import LandSalp, chain_parts
from salpchain.dynamics.robot import Part
from salpchain.dynamics.water import Water, added_mass
from salpchain.errors import InputError
from salpchain.world.current import Uniform

FREE = {"parts": (Part(-57.0, drag=(1e-12,) * 3),), "squares": (0.0,) * 3, "joint_drag": (0.0,)}


@pytest.fixture(autouse=True)
def double():
    with jax.enable_x64(True):
        yield


def swim(water, chain, thrusts, current=None):
    def step(chain, thrust):
        chain = water.advance(chain, thrust, current)
        return chain, water.energy(chain)

    return jax.jit(lambda c, u: jax.lax.scan(step, c, u))(chain, jnp.asarray(thrusts))


def moving(water, bends=(0.4, -0.3, 0.2)):
    """A bent chain that its jets have set in motion."""
    chain = water.straight(len(bends) + 1, jnp.array(bends))
    return swim(water, chain, np.tile([1.0, 0.2, 0.7, 0.4], (3, 1)))[0]


def test_without_inertia_it_is_the_law_of_landsalp():
    parts, bends = chain_parts(), jnp.array([0.4, -0.3, 0.2])
    given = {"parts": parts, "joint_drag": (0.0126,), "jet": 1.8}
    thrust, step = jnp.array([0.3, 0.2, 0.5, 0.1]), 1e-6
    water = Water(squares=(0.0,) * 3, inertia=1e-12, control_step=step, lag=0.0, **given)
    slow = LandSalp(control_step=step, **given)
    for name in ("velocity", "angular_velocity"):
        one, other = (
            getattr(d.advance(d.straight(4, bends), thrust).units, name) for d in (water, slow)
        )
        assert np.allclose(one, other, rtol=1e-4)


def test_a_chain_that_coasts_loses_energy_in_every_step():
    water = Water()
    _, energies = swim(water, moving(water), np.zeros((40, 4)))
    assert float(energies[0]) > 1e-6 and np.all(np.diff(energies) < 0)


def test_without_drag_energy_is_kept_the_better_the_shorter_the_step():
    lost = []
    for substeps in (12, 24):
        water = Water(substeps=substeps, lag=0.0, **FREE)
        fine = Water(substeps=400, lag=0.0, **FREE)
        chain = moving(fine)
        _, energies = swim(water, chain, np.zeros((4, 4)))
        lost.append(abs(float(energies[-1] / fine.energy(chain)) - 1))
    assert lost[1] < 0.6 * lost[0] and lost[1] < 0.05


def test_without_drag_momentum_is_what_the_jets_gave():
    """Of bodies as heavy along as across: of added mass it is not the links' own."""
    water = Water(mass=(2.0, 2.0, 0.02), lag=0.0, **FREE)
    chain = moving(water)
    after, _ = swim(water, chain, np.zeros((10, 4)))
    one, other = (c.units.velocity.sum(axis=0) for c in (chain, after))
    assert np.allclose(one, other, rtol=1e-9)


def test_the_energy_that_jets_give_is_lost_or_kept():
    """Power of the jets = drag and what is kept, to the order of the step."""
    water = Water(substeps=200, lag=0.0, parts=(Part(-57.0, drag=(0.02, 0.05, 1e-4)),))
    chain, energies = swim(water, water.straight(1), np.ones((1, 1)))
    after, more = swim(water, chain, np.ones((1, 1)))
    assert float(more[0]) > float(energies[0])
    rate = water.jet * float(jnp.linalg.norm(after.units.velocity[0]))
    assert float(more[0] - energies[0]) < rate * water.control_step


def test_jets_push_one_way_and_follow_with_their_lag():
    water = Water(control_step=0.1, lag=0.2)
    still, _ = swim(water, water.straight(2), np.full((3, 2), -1.0))
    assert not np.any(still.units.velocity)
    chain, _ = swim(water, water.straight(2), np.ones((2, 2)))
    assert np.allclose(chain.jets[:, 0], 1 - np.exp(-1.0))


def test_a_jet_that_is_empty_must_fill_again():
    water = Water(control_step=0.1, lag=0.0, pulse=0.5, refill=1.0)
    chain, _ = swim(water, water.straight(1), np.ones((20, 1)))
    assert float(chain.jets[0, 1]) < 0.1 and float(chain.jets[0, 0]) < 0.7
    chain, _ = swim(water, chain, np.zeros((20, 1)))
    assert float(chain.jets[0, 1]) > 0.8


def test_in_a_current_it_swims_as_in_still_water_that_moves():
    water, bends = Water(), jnp.array([0.4, -0.3])
    thrusts, flow = np.tile([1.0, 0.2, 0.7], (3, 1)), np.array([0.02, 0.01])
    still, _ = swim(water, water.straight(3, bends), thrusts)
    carried = eqx.tree_at(
        lambda c: c.units.velocity, water.straight(3, bends), jnp.tile(flow, (3, 1))
    )
    carried, _ = swim(water, carried, thrusts, Uniform(flow))
    way = flow * 3 * water.control_step
    assert np.allclose(carried.units.position - way, still.units.position, atol=1e-9)


def test_added_mass_is_that_of_lambs_table():
    for aspect, along, across, turning in ((1.5, 0.305, 0.621, 0.094), (2.99, 0.122, 0.803, 0.465)):
        assert added_mass(aspect) == pytest.approx((along, across, turning), abs=2e-3)
    assert added_mass(1.0001)[:2] == pytest.approx((0.5, 0.5), abs=1e-3)
    with pytest.raises(InputError, match="longer than wide"):
        added_mass(1.0)


def test_what_cannot_be_is_refused():
    with pytest.raises(InputError, match=r"Water\.mass must be three numbers"):
        Water(mass=(1.0, -1.0, 1.0))
    with pytest.raises(InputError, match=r"pulse must be 0 or more"):
        Water(pulse=-1.0)
