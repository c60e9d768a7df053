"""What every graph controller must be, whatever its layers."""

from functools import cache, partial

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

from salpchain.controllers.policy import Policy, PolicyCard
from salpchain.errors import InputError
from salpchain.networks.actor_critic import actor_critic, num_parameters
from salpchain.networks.config import ControlConfig
from salpchain.networks.graph import GRAPHS, full, hub, mixed, near, of_adjacency
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.reach.task import SCLD
from salpchain.xla import flat_products


def all_of(units):
    return jnp.ones(units, bool), jnp.ones(units - 1, bool)


@cache
def network(model="gcn", graph="mixed", shake=0.01, depth=2):
    config = ControlConfig(model=model, graph=graph, depth=depth)
    return shaken(actor_critic(jr.key(0), config, 24, 2, 8), shake)


def shaken(policy, by=0.1):
    """The policy with something added to every weight, so that none is zero."""
    return jax.tree.map(lambda x: x + by * jr.normal(jr.key(1), x.shape), policy)


def observed(units):
    return jr.normal(jr.key(2), (units, 24))


# Compiled, for operation by operation takes longer.
call = eqx.filter_jit(lambda policy, *given: policy(*given))
act = eqx.filter_jit(lambda policy, *given: policy.act(*given))

models = pytest.mark.parametrize("model", ["gcn", "gatv2", "gt"])
graphs = pytest.mark.parametrize("graph", GRAPHS)


@pytest.mark.parametrize(
    ("model", "count"), [("gcn", 102_804), ("gatv2", 162_452), ("gt", 318_740)]
)
def test_the_parameter_counts_are_the_papers(model, count):
    assert num_parameters(model, 24, 8) == count


@pytest.mark.parametrize(
    ("graph", "edges"),
    [(mixed, 8 + 2 * 7), (full, 64), (near, 8 + 2 * (7 + 6 + 5 + 4)), (hub, 8 + 2 * 7 + 8 + 2)],
)
def test_the_graphs_have_as_many_edges_as_they_should(graph, edges):
    """The hub's edges from the units weigh 1 together."""
    assert int(graph(*all_of(8)).degree().sum()) == edges


@models
def test_a_graph_is_added_to_one_table(model, monkeypatch):
    monkeypatch.setitem(GRAPHS, "alone", lambda present, joined: of_adjacency(jnp.diag(present)))
    config, obs = ControlConfig(model=model, graph="alone"), observed(4)
    policy = actor_critic(jr.key(0), config, 24, 2, 8)
    base, moved = (act(policy, x, *all_of(4)) for x in (obs, obs.at[1].add(1.0)))
    changed = np.abs(np.asarray(moved - base)).max(axis=1) > 1e-7
    np.testing.assert_array_equal(np.flatnonzero(changed), [1])
    with pytest.raises(InputError, match=r"unknown graph 'alon': choose one of mixed, .* alone"):
        ControlConfig(graph="alon")


@models
def test_on_mixed_a_unit_hears_of_units_up_to_two_links_away_and_no_farther(model):
    policy, obs = network(model), observed(9)
    base = act(policy, obs, *all_of(9))
    moved = act(policy, obs.at[4].add(1.0), *all_of(9))
    changed = np.abs(np.asarray(moved - base)).max(axis=1) > 1e-7
    np.testing.assert_array_equal(np.flatnonzero(changed), [2, 3, 4, 5, 6])


def test_a_hub_hears_the_mean_of_the_units_so_that_a_chain_twice_as_long_changes_nothing():
    values = jnp.concatenate([observed(6), jnp.ones((1, 24))])
    twice = jnp.concatenate([values[:6], values[:6], values[6:]])
    heard = hub(*all_of(6)).gather(values)[-1]
    np.testing.assert_allclose(heard, values[:6].mean(axis=0) + 1, atol=1e-6)
    np.testing.assert_allclose(hub(*all_of(12)).gather(twice)[-1], heard, atol=1e-6)
    present = jnp.arange(9) < 6
    slotted = jnp.concatenate([values[:6], jnp.full((3, 24), 1e3), values[6:]])
    np.testing.assert_allclose(hub(present, present[1:]).gather(slotted)[-1], heard, atol=1e-5)


@models
def test_each_layer_more_lets_a_unit_hear_one_link_farther(model):
    policy, obs = network(model, depth=4), observed(13)
    moved = act(policy, obs.at[6].add(3.0), *all_of(13)) - act(policy, obs, *all_of(13))
    changed = np.asarray(moved).any(axis=1)
    np.testing.assert_array_equal(np.flatnonzero(changed), range(2, 11))


@pytest.mark.parametrize("graph", ["full", "hub"])
@models
def test_on_full_and_through_a_hub_every_unit_hears_every_unit(model, graph):
    policy, obs = network(model, graph), observed(9)
    moved = act(policy, obs.at[4].add(1.0), *all_of(9)) - act(policy, obs, *all_of(9))
    assert (np.abs(np.asarray(moved)).max(axis=1) > 1e-7).all()


def test_gcn_on_full_thrusts_the_same_everywhere_so_the_chain_can_never_turn():
    action = act(network("gcn", "full"), observed(8), *all_of(8))
    np.testing.assert_allclose(action, jnp.broadcast_to(action[0], action.shape), atol=1e-6)
    mixed_action = act(network("gcn", "mixed"), observed(8), *all_of(8))
    assert np.abs(mixed_action - mixed_action[0]).max() > 1e-3


def test_the_two_units_of_a_pair_act_alike_unless_a_unit_counts_twice_for_itself():
    config = ControlConfig(improved=True)
    pair = observed(2), *all_of(2)
    alike = act(network(shake=0.1), *pair)
    np.testing.assert_allclose(alike[0], alike[1], atol=1e-6)
    unlike = act(shaken(actor_critic(jr.key(0), config, 24, 2, 8)), *pair)
    assert np.abs(unlike[0] - unlike[1]).max() > 1e-2


def test_a_depth_that_cannot_be_is_refused():
    for config, message in (
        ({"depth": 1}, "depth must be 2 to 8 layers, got 1"),
        ({"depth": 9}, "depth must be 2 to 8 layers, got 9"),
        (
            {"model": "mlp", "depth": 3},
            "depth must stay 2 for an mlp, which has no graph",
        ),
    ):
        with pytest.raises(InputError, match=message):
            ControlConfig(**config)


def test_improved_belongs_to_gcn():
    with pytest.raises(InputError, match="improved belongs to the model gcn, got model gt"):
        ControlConfig(model="gt", improved=True)


@pytest.mark.parametrize("model", ["gatv2", "gt"])
def test_attention_on_full_tells_units_apart(model):
    action = act(network(model, "full", shake=0.1), observed(8), *all_of(8))
    assert np.abs(action - action[0]).max() > 1e-2


@models
@graphs
def test_a_chain_in_more_slots_gets_the_actions_and_the_value_it_gets_alone(model, graph):
    policy, obs = network(model, graph), observed(5)
    slotted = jnp.concatenate([obs, jnp.full((4, 24), 1e3)])
    present = jnp.arange(9) < 5
    action, value = call(policy, obs, *all_of(5))
    in_slots, same_value = call(policy, slotted, present, present[1:])
    np.testing.assert_allclose(in_slots[:5], action, atol=1e-5)
    assert float(same_value) == pytest.approx(float(value), abs=1e-5)


@models
def test_a_cut_chain_on_mixed_is_steered_as_two_chains(model):
    policy, obs = network(model), observed(8)
    present, joined = all_of(8)
    both = act(policy, obs, present, joined.at[3].set(False))
    parts = [act(policy, part, *all_of(4)) for part in (obs[:4], obs[4:])]
    np.testing.assert_allclose(both, jnp.concatenate(parts), atol=1e-5)


@models
@graphs
def test_turning_the_chain_round_turns_the_actions_round(model, graph):
    policy, obs = network(model, graph), observed(8)
    there, back = act(policy, obs, *all_of(8)), act(policy, obs[::-1], *all_of(8))
    np.testing.assert_allclose(back[::-1], there, atol=1e-5)


@models
@graphs
@pytest.mark.parametrize("units", [2, 70])
def test_the_same_weights_serve_any_length(model, graph, units):
    action, value = call(network(model, graph), observed(units), *all_of(units))
    assert action.shape == (units, 2)
    assert np.isfinite(action).all() and np.isfinite(value)


@models
def test_a_graph_of_ones_own_may_change_over_time(model):
    """One compiled program for all graphs: the adjacency is data."""
    policy, obs = network(model), observed(6)
    on = jax.jit(lambda sees: policy.act(obs, *all_of(6), of_adjacency(sees)))
    chain = jnp.asarray(np.eye(6, k=1, dtype=bool) | np.eye(6, k=-1, dtype=bool))
    np.testing.assert_allclose(on(chain), act(policy, obs, *all_of(6)), atol=1e-5)
    everyone = on(jnp.ones((6, 6), bool))
    np.testing.assert_allclose(everyone, act(policy, obs, *all_of(6), full(*all_of(6))), atol=1e-5)
    alone = on(jnp.zeros((6, 6), bool))
    np.testing.assert_allclose(
        alone[2],
        act(policy, obs[2:4], *all_of(2), of_adjacency(jnp.zeros((2, 2), bool)))[0],
        atol=1e-5,
    )
    assert on._cache_size() == 1


@models
def test_flat_products_change_no_gradient_of_a_batch_nor_of_policies_side_by_side(model):
    policies = jax.tree.map(lambda x: jnp.stack([x, 2 * x]), network(model))
    obs = jnp.stack([observed(5), -observed(5)])

    @jax.jit
    @partial(jax.vmap, in_axes=(0, None))
    @jax.grad
    def gradient(policy, obs):
        action, value = jax.vmap(policy, (0, None, None))(obs, *all_of(5))
        return (action**2).sum() + (value**2).sum()

    plain = gradient(policies, obs)
    gradient.clear_cache()
    with flat_products():
        flat = gradient(policies, obs)
    for one, other in zip(jax.tree.leaves(flat), jax.tree.leaves(plain), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-4, atol=1e-4 * np.abs(other).max() + 1e-7)


def policy_of(model):
    config = ControlConfig(model=model)
    card = PolicyCard(model, config, length=4)
    return Policy(actor_critic(jr.key(0), config, 22, 1, 4), card)


def test_a_policy_acts_on_a_graph_of_ones_own_of_its_chains_size():
    state, policy = SCLD(TaskConfig(length=4)).reset(jr.key(0)), policy_of("gcn")
    alone = policy.act(state, of_adjacency(np.zeros((4, 4), bool)))
    assert not np.allclose(alone, policy.act(state), atol=1e-6)
    for plain in (np.zeros((4, 4), bool), [[False] * 4] * 4):
        np.testing.assert_array_equal(policy.act(state, plain), alone)
    with pytest.raises(InputError, match="the graph has 5 nodes, the chain 4 slots"):
        policy.act(state, of_adjacency(np.zeros((5, 5), bool)))
    with pytest.raises(InputError, match="an mlp has no graph"):
        policy_of("mlp").act(state, of_adjacency(np.zeros((4, 4), bool)))


@pytest.mark.parametrize("given", [np.ones((3, 4), bool), np.ones(4, bool), np.ones((4, 4))])
def test_a_graph_that_is_no_square_of_booleans_is_refused(given):
    with pytest.raises(InputError, match=r"an \(n, n\) array of bool, got \w+ of shape"):
        of_adjacency(given)


@pytest.mark.parametrize("given", ["full", [[True], [True, False]], [[None]]])
def test_a_graph_that_is_no_array_is_refused(given):
    state, policy = SCLD(TaskConfig(length=4)).reset(jr.key(0)), policy_of("gcn")
    with pytest.raises(InputError, match=r"an \(n, n\) array of bool, got"):
        policy.act(state, given)


def test_the_task_of_a_policy_speaks_its_language_and_another_is_refused():
    config = ControlConfig()
    card = PolicyCard(control=config, observation="proximity", action="pair", length=4)
    policy = Policy(actor_critic(jr.key(0), config, 24, 2, 4), card)
    task = card.task(5, folded=0.5)
    assert task == TaskConfig(5, "proximity", "pair", "scaled", folded=0.5)
    assert policy.act(SCLD(task).reset(jr.key(0))).shape == (5, 2)
    with pytest.raises(InputError, match="observes proximity, the state has 22 numbers"):
        policy.act(SCLD(TaskConfig(5)).reset(jr.key(0)))
    with pytest.raises(InputError, match="works at 4 units only, got length 5"):
        PolicyCard(control=ControlConfig(model="mlp"), length=4).task(5)
