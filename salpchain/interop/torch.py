"""States as torch tensors and back, through DLPack: no copy where both are on the same device.

A tensor made from a JAX array shares its memory, and JAX takes for granted that nobody writes
there: treat it as read-only, or `clone` it.
"""

from textwrap import shorten
from typing import Any

import jax
import jax.numpy as jnp

from salpchain.errors import InputError
from salpchain.given import instance, told
from salpchain.interop.extras import need

need("torch", "torch")

import torch
from torch import Tensor


def checked_device(device: Any) -> Any:
    """The device of torch.

    Raises:
        InputError: torch knows none by this, or it is not there.
    """
    try:
        found = torch.device(device)
        torch.empty(0, device=found)
    except (TypeError, RuntimeError, AssertionError) as error:
        why = shorten(str(error), 90)
        raise InputError(
            f"device must be one of torch's, such as 'cpu' or 'cuda', got {told(device)} ({why})"
        ) from None
    return found


def to_torch(array: jax.Array) -> Tensor:
    """The array as a tensor on the same device, without a copy.

    Raises:
        InputError: random keys, or no JAX array.
    """
    if not isinstance(array, jax.Array) or jnp.issubdtype(array.dtype, jax.dtypes.prng_key):
        raise InputError(f"only JAX arrays of numbers become tensors, got {told(array)}")
    return torch.from_dlpack(array)


def to_jax(tensor: Tensor) -> jax.Array:
    """The tensor as an array on the same device; without a copy where its memory is aligned.

    Gradients do not pass: the tensor is detached first.

    Raises:
        InputError: no tensor.
    """
    instance("tensor", tensor, Tensor, "a tensor of torch")
    return jnp.from_dlpack(tensor.detach().contiguous())


def as_tensors(tree: Any) -> dict[str, Tensor]:
    """The arrays of any record, such as a `State`, by their dotted names, as tensors.

    Random keys are left out, for torch has no such type, and so is what is no JAX array.
    """
    leaves, _ = jax.tree_util.tree_flatten_with_path(tree)
    return {
        jax.tree_util.keystr(path).lstrip("."): to_torch(leaf)
        for path, leaf in leaves
        if isinstance(leaf, jax.Array) and not jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key)
    }
