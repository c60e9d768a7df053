"""The graph convolutional trunk (paper Table 3; DESIGN section 5)."""

import equinox as eqx
import jax.random as jr
from jaxtyping import Array, Float, PRNGKeyArray

from salpchain.control.graph import Graph
from salpchain.control.layers import WIDTH, GCNConv, gcn_conv, gelu, layer_norm


class GCN(eqx.Module):
    """GCN, GELU, layer norm without parameters, GCN, GELU."""

    first: GCNConv
    second: GCNConv

    def __call__(self, x: Float[Array, "unit inputs"], graph: Graph) -> Float[Array, "unit 128"]:
        """Features of each unit from what the units within two edges of it observe."""
        return gelu(self.second(layer_norm(gelu(self.first(x, graph))), graph))


def gcn(key: PRNGKeyArray, inputs: int) -> GCN:
    """A trunk with fresh weights."""
    first_key, second_key = jr.split(key)
    return GCN(gcn_conv(first_key, inputs, WIDTH), gcn_conv(second_key, WIDTH, WIDTH))
