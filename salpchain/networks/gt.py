"""The graph transformer trunk (paper Table 3)."""

import equinox as eqx
import jax.random as jr
from jaxtyping import Array, Float, PRNGKeyArray

from salpchain.networks.config import ControlConfig
from salpchain.networks.graph import Graph
from salpchain.networks.layers import (
    WIDTH,
    LayerNorm,
    Linear,
    TransformerConv,
    gelu,
    linear,
    new_layer_norm,
    transformer_conv,
)

HEADS = 2  # averaged (paper Table 3)


class Block(eqx.Module):
    """Graph transformer layer, GELU, residual, layer norm with parameters."""

    layer: TransformerConv
    norm: LayerNorm

    def __call__(self, x: Float[Array, "unit 128"], graph: Graph) -> Float[Array, "unit 128"]:
        """(unit, 128) to (unit, 128)."""
        return self.norm(x + gelu(self.layer(x, graph)))


class GT(eqx.Module):
    """A linear layer, then blocks (paper Table 3: two)."""

    entry: Linear
    blocks: list[Block]

    def __call__(self, x: Float[Array, "unit inputs"], graph: Graph) -> Float[Array, "unit 128"]:
        """Features of each unit from what the units within as many edges of it observe."""
        x = self.entry(x)
        for block in self.blocks:
            x = block(x, graph)
        return x


def gt(key: PRNGKeyArray, inputs: int, config: ControlConfig) -> GT:
    """A trunk with fresh weights."""
    entry_key, *keys = jr.split(key, 1 + config.depth)
    blocks = [Block(transformer_conv(k, WIDTH, WIDTH, HEADS), new_layer_norm(WIDTH)) for k in keys]
    return GT(linear(entry_key, inputs, WIDTH), blocks)
