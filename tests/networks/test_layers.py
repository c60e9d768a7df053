"""Our layers and those of PyTorch Geometric with the same weights, on any graph."""

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

from salpchain.networks.actor_critic import actor_critic
from salpchain.networks.config import REACH, ControlConfig
from salpchain.networks.graph import full, mixed, near, of_adjacency
from salpchain.networks.layers import (
    Linear,
    gatv2_conv,
    gcn_conv,
    gelu,
    layer_norm,
    new_layer_norm,
    transformer_conv,
)

torch = pytest.importorskip("torch", reason="torch comes with the test extra")
nn = pytest.importorskip("torch_geometric.nn", reason="PyG comes with the test extra")

INPUTS, OUTPUTS, SLOTS = 5, 6, 9
ALIVE = np.arange(SLOTS) < 7


def chain_graph(joined):
    sees = np.diag(ALIVE)
    side = joined & ALIVE[:-1] & ALIVE[1:]
    return sees | np.diag(side, 1) | np.diag(side, -1)


def near_graph(joined):
    steps = chain_graph(joined).astype(int)
    return np.linalg.matrix_power(steps, REACH) > 0


def random_graph(seed):
    sees = np.random.default_rng(seed).random((SLOTS, SLOTS)) < 0.4
    return (sees | np.eye(SLOTS, dtype=bool)) & ALIVE & ALIVE[:, None]


WHOLE = np.ones(SLOTS - 1, bool)
CUT = np.arange(SLOTS - 1) != 2
PRESENT = jnp.asarray(ALIVE)
BOTH = jnp.asarray(ALIVE[:-1] & ALIVE[1:])
# Ours, and who sees whom; the last two of nine slots are empty.
GRAPHS = {
    "mixed": (mixed(PRESENT, BOTH), chain_graph(WHOLE)),
    "mixed, cut": (mixed(PRESENT, BOTH & CUT), chain_graph(CUT)),
    "full": (full(PRESENT, BOTH), ALIVE[:, None] & ALIVE),
    "near": (near(PRESENT, BOTH), near_graph(WHOLE)),
    "near, cut": (near(PRESENT, BOTH & CUT), near_graph(CUT)),
    "random": (of_adjacency(jnp.asarray(random_graph(0))), random_graph(0)),
    "another": (of_adjacency(jnp.asarray(random_graph(1))), random_graph(1)),
}


def edges(sees):
    """PyG's edges, from the node that is heard to the node that hears."""
    hearer, heard = np.nonzero(sees)
    return torch.tensor(np.stack([heard, hearer]))


def shaken(layer):
    """The layer with no weight at its start value, so that none can hide."""
    leaves, tree = jax.tree.flatten(layer)
    keys = jr.split(jr.key(9), len(leaves))
    return tree.unflatten(
        [x + 0.3 * jr.normal(k, x.shape) for k, x in zip(keys, leaves, strict=True)]
    )


def copy(theirs, ours):
    """Our weights in a torch parameter or linear layer."""
    with torch.no_grad():
        if isinstance(ours, Linear):
            theirs.weight.copy_(torch.tensor(np.array(ours.weight)).T)
            if theirs.bias is not None:
                theirs.bias.copy_(torch.tensor(np.array(ours.bias)))
        else:
            theirs.copy_(torch.tensor(np.array(ours)).reshape(theirs.shape))


def gcn_pair():
    ours = shaken(gcn_conv(jr.key(0), INPUTS, OUTPUTS))
    theirs = nn.GCNConv(INPUTS, OUTPUTS, add_self_loops=False)
    copy(theirs.lin.weight, ours.linear.weight.T)
    copy(theirs.bias, ours.linear.bias)
    return ours, theirs


def improved_pair():
    ours = shaken(gcn_conv(jr.key(0), INPUTS, OUTPUTS, improved=True))
    theirs = nn.GCNConv(INPUTS, OUTPUTS, improved=True)
    copy(theirs.lin.weight, ours.linear.weight.T)
    copy(theirs.bias, ours.linear.bias)
    # Without weights of the edges, PyG 2.8 gives its self loops the weight 1, improved or not.
    return ours, lambda x, graph: theirs(x, graph, torch.ones(graph.shape[1]))


def gatv2_pair():
    ours = shaken(gatv2_conv(jr.key(0), INPUTS, OUTPUTS, 2))
    theirs = nn.GATv2Conv(INPUTS, OUTPUTS, heads=2, add_self_loops=False)
    copy(theirs.lin_l, ours.source)
    copy(theirs.lin_r, ours.target)
    copy(theirs.att, ours.attention)
    copy(theirs.bias, ours.bias)
    return ours, theirs


def gt_pair():
    ours = shaken(transformer_conv(jr.key(0), INPUTS, OUTPUTS, 2))
    theirs = nn.TransformerConv(INPUTS, OUTPUTS, heads=2, concat=False, beta=True)
    for name in ("query", "key", "value", "skip"):
        copy(getattr(theirs, f"lin_{name}"), getattr(ours, name))
    copy(theirs.lin_beta.weight, ours.gate)
    return ours, theirs


# Compiled, for operation by operation takes longer.
run = eqx.filter_jit(lambda layer, x, graph: layer(x, graph))
slope = eqx.filter_jit(jax.grad(lambda x, layer, graph: (layer(x, graph)[ALIVE] ** 2).sum()))

PAIRS = {"gcn": gcn_pair, "improved": improved_pair, "gatv2": gatv2_pair, "gt": gt_pair}


def given(layer, graph):
    """Both layers, the graph as each wants it, and features."""
    ours_graph, sees = GRAPHS[graph]
    x = np.random.default_rng(1).normal(size=(SLOTS, INPUTS)).astype(np.float32)
    if layer == "improved":  # PyG adds self loops where there are none
        sees = sees & ~np.eye(SLOTS, dtype=bool)
    return *PAIRS[layer](), ours_graph, edges(sees), x


@pytest.mark.parametrize("graph", GRAPHS)
@pytest.mark.parametrize("layer", PAIRS)
def test_a_layer_does_what_pygs_does(layer, graph):
    ours, theirs, ours_graph, theirs_graph, x = given(layer, graph)
    expected = theirs(torch.tensor(x), theirs_graph).detach().numpy()[ALIVE]
    x[~ALIVE] = 1e6  # what an empty slot holds must not matter
    np.testing.assert_allclose(run(ours, jnp.asarray(x), ours_graph)[ALIVE], expected, atol=1e-5)


@pytest.mark.parametrize("graph", GRAPHS)
@pytest.mark.parametrize("layer", PAIRS)
def test_its_gradient_is_pygs_too(layer, graph):
    ours, theirs, ours_graph, theirs_graph, x = given(layer, graph)
    traced = torch.tensor(x, requires_grad=True)
    (theirs(traced, theirs_graph)[torch.tensor(ALIVE)] ** 2).sum().backward()
    gradient = slope(jnp.asarray(x), ours, ours_graph)
    np.testing.assert_allclose(gradient[ALIVE], traced.grad.numpy()[ALIVE], rtol=1e-4, atol=1e-4)
    assert not np.asarray(gradient[~ALIVE]).any()


def test_the_critics_pooling_is_pygs():
    policy = shaken(actor_critic(jr.key(0), ControlConfig(), INPUTS, 2, 8))
    features = jr.normal(jr.key(1), (SLOTS, 128))
    gate = torch.nn.Sequential(torch.nn.Linear(128, 128), torch.nn.GELU(), torch.nn.Linear(128, 1))
    for theirs, ours in zip((gate[0], gate[2]), policy.score.layers, strict=True):
        copy(theirs, ours)
    pooled = nn.AttentionalAggregation(gate)(torch.tensor(np.array(features[ALIVE])))
    expected = policy.critic(jnp.asarray(pooled.detach().numpy()))[0, 0]
    value = policy.value(features, PRESENT)
    assert float(value) == pytest.approx(float(expected), rel=1e-4)


def test_activation_and_norms_are_torchs():
    x = np.random.default_rng(0).normal(size=(4, 128)).astype(np.float32) * 3
    theirs = torch.tensor(x)
    np.testing.assert_allclose(gelu(jnp.asarray(x)), torch.nn.functional.gelu(theirs), atol=2e-6)
    norm = torch.nn.functional.layer_norm(theirs, (128,))
    np.testing.assert_allclose(layer_norm(jnp.asarray(x)), norm, atol=2e-5)
    ours, learned = shaken(new_layer_norm(128)), torch.nn.LayerNorm(128)
    copy(learned.weight, ours.scale)
    copy(learned.bias, ours.shift)
    np.testing.assert_allclose(ours(jnp.asarray(x)), learned(theirs).detach(), atol=2e-5)


def largest_array(layer, graph, units):
    """Numbers in the largest array of a layer's forward and backward pass."""
    x = jax.ShapeDtypeStruct((units, INPUTS), jnp.float32)
    sees = jax.ShapeDtypeStruct((units, units), bool)

    def total(x, layer, sees):
        return layer(x, graph(sees)).sum()

    jaxpr = jax.make_jaxpr(jax.grad(total))(x, layer, sees)
    return max(_sizes(jaxpr.jaxpr))


def _sizes(jaxpr):
    for equation in jaxpr.eqns:
        yield from (var.aval.size for var in equation.outvars)
        for value in equation.params.values():
            for inner in value if isinstance(value, (tuple, list)) else (value,):
                inner = getattr(inner, "jaxpr", inner)
                if hasattr(inner, "eqns"):
                    yield from _sizes(inner)


@pytest.mark.parametrize("layer", ["gatv2", "gt"])
def test_any_graph_takes_the_memory_of_scores_not_of_features_of_all_pairs(layer):
    make = {"gatv2": gatv2_conv, "gt": transformer_conv}[layer]
    units, heads, features = 64, 2, 32
    layer = make(jr.key(0), INPUTS, features, heads)
    most = max(units * units * heads, units * heads * features, features * heads * INPUTS)
    assert largest_array(eqx.filter(layer, eqx.is_array), of_adjacency, units) <= most
