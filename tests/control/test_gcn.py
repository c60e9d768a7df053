import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

from salpchain.control.actor_critic import actor_critic
from salpchain.control.config import ControlConfig
from salpchain.control.count import num_parameters
from salpchain.control.graph import DenseGraph, full, mixed
from salpchain.control.layers import gcn_conv, gelu, layer_norm


def all_of(units):
    return jnp.ones(units, bool), jnp.ones(units - 1, bool)


def network(graph="mixed", inputs=24):
    policy = actor_critic(jr.key(0), ControlConfig(graph=graph), inputs, 2, 8)
    return jax.tree.map(lambda x: x + 0.01 * jr.normal(jr.key(1), x.shape), policy)


def test_the_parameter_count_is_the_papers():
    assert num_parameters("gcn", 24, 8) == 102_804


@pytest.mark.parametrize(("graph", "edges"), [(mixed, 8 + 2 * 7), (full, 64)])
def test_the_graphs_have_the_papers_numbers_of_edges(graph, edges):
    assert int(graph(*all_of(8)).degree().sum()) == edges


def reference(x, layer, adjacency):
    """Kipf and Welling's layer by matrices: D^-1/2 A D^-1/2 X W + b."""
    scale = np.diag(1 / np.sqrt(adjacency.sum(1)))
    weight, bias = np.asarray(layer.linear.weight), np.asarray(layer.linear.bias)
    return scale @ adjacency @ scale @ x @ weight + bias


@pytest.mark.parametrize("units", [2, 3, 8, 20])
def test_the_layer_is_kipf_and_wellings_on_the_chain(units):
    layer = gcn_conv(jr.key(0), 5, 7)
    x = jr.normal(jr.key(1), (units, 5))
    adjacency = np.eye(units) + np.eye(units, k=1) + np.eye(units, k=-1)
    ours = layer(x, mixed(*all_of(units)))
    np.testing.assert_allclose(ours, reference(np.asarray(x), layer, adjacency), atol=1e-5)


def test_the_layer_takes_any_graph():
    rng = np.random.default_rng(0)
    sees = rng.random((9, 9)) < 0.4
    sees = sees | sees.T | np.eye(9, dtype=bool)
    layer, x = gcn_conv(jr.key(0), 5, 7), jr.normal(jr.key(1), (9, 5))
    ours = layer(x, DenseGraph(jnp.asarray(sees)))
    np.testing.assert_allclose(ours, reference(np.asarray(x), layer, sees.astype(float)), atol=1e-5)


def test_activation_and_norm_are_torchs():
    torch = pytest.importorskip("torch", reason="torch comes with the test extra")
    x = np.random.default_rng(0).normal(size=(4, 128)).astype(np.float32) * 3
    theirs = torch.tensor(x)
    np.testing.assert_allclose(gelu(jnp.asarray(x)), torch.nn.functional.gelu(theirs), atol=2e-6)
    norm = torch.nn.functional.layer_norm(theirs, (128,))
    np.testing.assert_allclose(layer_norm(jnp.asarray(x)), norm, atol=2e-5)


def test_a_unit_hears_of_units_up_to_two_links_away_and_no_farther():
    policy, obs = network(), jr.normal(jr.key(2), (9, 24))
    base = policy.act(obs, *all_of(9))
    moved = policy.act(obs.at[4].add(1.0), *all_of(9))
    changed = np.abs(np.asarray(moved - base)).max(axis=1) > 1e-7
    np.testing.assert_array_equal(np.flatnonzero(changed), [2, 3, 4, 5, 6])


def test_on_the_full_graph_every_unit_thrusts_the_same_so_the_chain_can_never_turn():
    action = network("full").act(jr.normal(jr.key(2), (8, 24)), *all_of(8))
    np.testing.assert_allclose(action, jnp.broadcast_to(action[0], action.shape), atol=1e-6)
    mixed_action = network("mixed").act(jr.normal(jr.key(2), (8, 24)), *all_of(8))
    assert np.abs(mixed_action - mixed_action[0]).max() > 1e-3


@pytest.mark.parametrize("graph", ["mixed", "full"])
def test_a_chain_in_more_slots_gets_the_actions_and_the_value_it_gets_alone(graph):
    policy, obs = network(graph), jr.normal(jr.key(2), (5, 24))
    slotted = jnp.concatenate([obs, jnp.full((4, 24), 1e3)])
    present = jnp.arange(9) < 5
    action, value = policy(obs, *all_of(5))
    in_slots, same_value = policy(slotted, present, present[1:])
    np.testing.assert_allclose(in_slots[:5], action, atol=1e-5)
    assert float(same_value) == pytest.approx(float(value), abs=1e-5)


def test_a_cut_chain_is_steered_as_two_chains():
    policy, obs = network(), jr.normal(jr.key(2), (8, 24))
    present, joined = all_of(8)
    both = policy.act(obs, present, joined.at[3].set(False))
    parts = [policy.act(part, *all_of(4)) for part in (obs[:4], obs[4:])]
    np.testing.assert_allclose(both, jnp.concatenate(parts), atol=1e-5)


def test_turning_the_chain_round_turns_the_actions_round():
    policy, obs = network(), jr.normal(jr.key(2), (8, 24))
    there, back = policy.act(obs, *all_of(8)), policy.act(obs[::-1], *all_of(8))
    np.testing.assert_allclose(back[::-1], there, atol=1e-5)
