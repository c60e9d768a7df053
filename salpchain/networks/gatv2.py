"""The graph attention trunk (paper Table 3)."""

import jax.random as jr
from jaxtyping import PRNGKeyArray

from salpchain.networks.config import ControlConfig
from salpchain.networks.layers import WIDTH, Layers, gatv2_conv

HEADS = 2  # of the first layer, in a row (paper Table 3)


def gatv2(key: PRNGKeyArray, inputs: int, config: ControlConfig) -> Layers:
    """A trunk with fresh weights."""
    first_key, second_key, *keys = jr.split(key, config.depth)
    return Layers(
        gatv2_conv(first_key, inputs, WIDTH, HEADS),
        gatv2_conv(second_key, HEADS * WIDTH, WIDTH, 1),
        [gatv2_conv(k, WIDTH, WIDTH, 1) for k in keys],
    )
