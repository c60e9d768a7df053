"""The graph attention trunk (paper Table 3; DESIGN section 5)."""

import equinox as eqx
import jax.random as jr
from jaxtyping import Array, Float, PRNGKeyArray

from salpchain.control.graph import Graph
from salpchain.control.layers import WIDTH, GATv2Conv, gatv2_conv, gelu, layer_norm

HEADS = 2  # of the first layer (paper Table 3)


class GATv2(eqx.Module):
    """GATv2 with two heads in a row, GELU, layer norm without parameters, GATv2, GELU."""

    first: GATv2Conv
    second: GATv2Conv

    def __call__(self, x: Float[Array, "unit inputs"], graph: Graph) -> Float[Array, "unit 128"]:
        """Features of each unit from what the units within two edges of it observe."""
        return gelu(self.second(layer_norm(gelu(self.first(x, graph))), graph))


def gatv2(key: PRNGKeyArray, inputs: int) -> GATv2:
    """A trunk with fresh weights."""
    first_key, second_key = jr.split(key)
    return GATv2(
        gatv2_conv(first_key, inputs, WIDTH, HEADS),
        gatv2_conv(second_key, HEADS * WIDTH, WIDTH, 1),
    )
