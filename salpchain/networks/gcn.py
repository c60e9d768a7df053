"""The graph convolutional trunk (paper Table 3)."""

import jax.random as jr
from jaxtyping import PRNGKeyArray

from salpchain.networks.config import ControlConfig
from salpchain.networks.layers import WIDTH, Layers, gcn_conv


def gcn(key: PRNGKeyArray, inputs: int, config: ControlConfig) -> Layers:
    """A trunk with fresh weights; `config.improved` as `GCNConv` has it."""
    widths = [inputs, *[WIDTH] * (config.depth - 1)]
    keys = jr.split(key, config.depth)
    first, second, *more = (
        gcn_conv(k, w, WIDTH, config.improved) for k, w in zip(keys, widths, strict=True)
    )
    return Layers(first, second, more)
