"""The graph convolutional trunk (paper Table 3; DESIGN section 5)."""

import jax.random as jr
from jaxtyping import PRNGKeyArray

from salpchain.control.layers import WIDTH, TwoLayers, gcn_conv


def gcn(key: PRNGKeyArray, inputs: int, improved: bool = False) -> TwoLayers:
    """A trunk with fresh weights; `improved` as `GCNConv` has it."""
    first_key, second_key = jr.split(key)
    return TwoLayers(
        gcn_conv(first_key, inputs, WIDTH, improved), gcn_conv(second_key, WIDTH, WIDTH, improved)
    )
