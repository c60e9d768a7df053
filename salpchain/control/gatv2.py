"""The graph attention trunk (paper Table 3; DESIGN section 5)."""

import jax.random as jr
from jaxtyping import PRNGKeyArray

from salpchain.control.layers import WIDTH, TwoLayers, gatv2_conv

HEADS = 2  # of the first layer, in a row (paper Table 3)


def gatv2(key: PRNGKeyArray, inputs: int) -> TwoLayers:
    """A trunk with fresh weights."""
    first_key, second_key = jr.split(key)
    return TwoLayers(
        gatv2_conv(first_key, inputs, WIDTH, HEADS),
        gatv2_conv(second_key, HEADS * WIDTH, WIDTH, 1),
    )
