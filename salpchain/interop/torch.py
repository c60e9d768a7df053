"""States as torch tensors and back, through DLPack: no copy where both are on the same device.

A tensor made from a JAX array shares its memory, and JAX takes for granted that nobody writes
there: treat it as read-only, or `clone` it.
"""

from typing import Any

import jax
import jax.numpy as jnp

from salpchain.interop.extras import need

need("torch", "torch")

import torch
from torch import Tensor


def to_torch(array: jax.Array) -> Tensor:
    """The array as a tensor on the same device, without a copy."""
    return torch.from_dlpack(array)


def to_jax(tensor: Tensor) -> jax.Array:
    """The tensor as an array on the same device; without a copy where its memory is aligned.

    Gradients do not pass: the tensor is detached first.
    """
    return jnp.from_dlpack(tensor.detach().contiguous())


def as_tensors(tree: Any) -> dict[str, Tensor]:
    """The arrays of any record, such as a `State`, by their dotted names, as tensors.

    Random keys are left out: torch has no such type.
    """
    leaves, _ = jax.tree_util.tree_flatten_with_path(tree)
    return {
        jax.tree_util.keystr(path).lstrip("."): to_torch(leaf)
        for path, leaf in leaves
        if not jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key)
    }
