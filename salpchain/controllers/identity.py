"""Which controller this is, whatever it is called: a hash of what makes it act as it does."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from types import ModuleType
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from salpchain.controllers import named
from salpchain.controllers.policy import Controller, Policy, PolicyCard
from salpchain.files import Arrays, StrPath
from salpchain.networks.config import ControlConfig
from salpchain.trees import to_arrays

DIGITS = 16  # hexadecimal: no two of a million controllers share them by chance


def identity(controller: Controller | StrPath) -> str:
    """16 hexadecimal digits that differ for controllers that act differently.

    Of a policy they follow from its weights, its network's settings, its observation and its
    action; its name and how long it was trained do not count. Of any other controller, from its
    name, its class and all that its attributes hold; one that knows better has a text `identity`.

    Raises:
        InputError: no controller, nor the name or path of one.
    """
    controller = named.controller(controller)
    if isinstance(controller, Policy):
        return identity_of_weights(controller.card, to_arrays(controller.network))
    own = getattr(controller, "identity", None)
    if isinstance(own, str) and own:
        return own
    return _digest([controller.card.name, _plain(controller, {})])


def identity_of_weights(card: PolicyCard, weights: Arrays) -> str:
    """The identity of a policy with this card and these named weights, in whatever precision."""
    standard = ControlConfig()
    control = {
        field.name: getattr(card.control, field.name)
        for field in fields(ControlConfig)  # a setting that is added later changes no old policy
        if getattr(card.control, field.name) != getattr(standard, field.name)
    }
    named = {name: _hash_of_array(array) for name, array in weights.items()}
    return _digest([control, card.observation, card.action, named])


def _digest(plain: Any) -> str:
    text = json.dumps(plain, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:DIGITS]


Met = dict[int, Any]  # what was gone through already, by its address


def _plain(value: Any, met: Met) -> Any:
    """The value as JSON that is the same in every process; arrays as hashes of their content."""
    if isinstance(value, jax.Array | np.ndarray | np.generic):
        return _hash_of_array(value)
    if value is None or isinstance(value, str | bytes | int | float):
        return repr(value)
    if isinstance(value, type | ModuleType):
        return value.__name__
    if isinstance(value, Policy):
        return identity(value)
    if id(value) in met:  # a controller may hold what holds it
        return f"again {list(met).index(id(value))}"
    met[id(value)] = value
    if isinstance(value, list | tuple):
        return [_plain(item, met) for item in value]
    if isinstance(value, set | frozenset):
        return sorted(repr(item) for item in value)
    if isinstance(value, Mapping):
        return {str(key): _plain(item, met) for key, item in value.items()}
    return [_kind(value), _plain(_attributes(value), met)]


def _hash_of_array(array: Any) -> list[Any]:
    """Shape and hash; numbers with a fraction in single precision, as they act."""
    if isinstance(array, jax.Array) and jnp.issubdtype(array.dtype, jax.dtypes.prng_key):
        array = jax.random.key_data(array)
    array = np.asarray(array)
    if array.dtype.kind == "f":
        array = array.astype("<f4")
    content = np.ascontiguousarray(array).tobytes()
    return [array.dtype.kind, list(array.shape), hashlib.sha256(content).hexdigest()]


def _kind(value: Any) -> str:
    """The name of a function, or of an object's class."""
    return getattr(value, "__qualname__", type(value).__qualname__)


def _attributes(value: Any) -> dict[str, Any]:
    if is_dataclass(value):
        return {f.name: getattr(value, f.name) for f in fields(value) if hasattr(value, f.name)}
    return dict(getattr(value, "__dict__", {}))
