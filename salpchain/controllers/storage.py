"""Policies as files: weights with all that one must know to run them. Data only, never code."""

from dataclasses import fields
from pathlib import Path
from typing import Any

import equinox as eqx
import jax.random as jr
import numpy as np

from salpchain.controllers.identity import identity_of_weights
from salpchain.controllers.named import WRITTEN
from salpchain.controllers.policy import Policy, PolicyCard, as_policy
from salpchain.controllers.released import released
from salpchain.errors import InputError
from salpchain.files import StrPath, read_arrays, write_arrays
from salpchain.given import flag, told
from salpchain.networks.actor_critic import ActorCritic, actor_critic
from salpchain.networks.config import ControlConfig
from salpchain.starting import check_can_compute
from salpchain.tasks.config import ACTION_SIZES
from salpchain.tasks.features import observation_size
from salpchain.trees import from_arrays, to_arrays

KIND = "policy"
VERSION = 1
POLICY_FILE = "policy.safetensors"
LATER = {
    "world",
    "task_name",
    "task_settings",
}  # what files of earlier versions do not say: the default holds


def save_policy(policy: Policy, path: StrPath, half: bool = False) -> None:
    """The policy as one file, atomically; with `half`, weights in half precision, rounded.

    The header has the policy's card, its `identity`, which no other weights have, and the type of
    its numbers. A file is read into the precision that JAX works with there.

    Raises:
        InputError: no learned policy, or there is no such folder.
        OSError: the folder is not writable, or the disk is full.
    """
    if not isinstance(policy, Policy):
        raise InputError(f"only a learned policy can be saved, got {told(policy)}")
    flag("half", half)
    arrays = to_arrays(policy.network)
    if half:
        arrays = {name: array.astype(np.float16) for name, array in arrays.items()}
    header = policy.card.as_dict() | {"identity": identity_of_weights(policy.card, arrays)}
    header["floats"] = str(next(iter(arrays.values())).dtype)
    write_arrays(path, KIND, VERSION, header, arrays)


def load(source: StrPath) -> Policy:
    """A released policy by its name, or the policy in a file or in the run folder of a training.

    Names are as in `salpchain.load`, but of learned policies only.

    Raises:
        InputError: no such name, file or folder; damaged, altered or from a newer version; the name
            of a controller that was never trained.
    """
    path = Path(source)
    if isinstance(source, str):
        if source in WRITTEN:
            raise InputError(f"{source} has no weights ({_meant()})")
        path = released().get(source, path)
    if source == "" or not path.exists():  # as a path, "" would be the working folder
        raise InputError(f"no such run folder or policy: {source or repr(source)} ({_meant()})")
    if path.is_dir():
        path = path / POLICY_FILE
        if not path.exists():
            yet = " yet: it comes with a training's first checkpoint"
            begun = yet if (path.parent / "config.json").exists() else ""
            raise InputError(
                f"{source} is not a run folder with a policy: it has no {POLICY_FILE}{begun}"
            )
    check_can_compute()
    header, arrays = read_arrays(path, KIND, VERSION)
    card = _card(header, path)
    network = from_arrays(network_shapes(card), arrays, str(path), cast=True)
    return as_policy(network, card)


def _meant() -> str:
    """What to say where neither a name nor a path leads to a policy."""
    return f"a learned policy is meant: {', or '.join(['a path', *released()])}"


def network_shapes(card: PolicyCard) -> ActorCritic:
    """The network of such a policy with shapes for arrays."""
    sizes = observation_size(card.observation), ACTION_SIZES[card.action]
    return eqx.filter_eval_shape(actor_critic, jr.key(0), card.control, *sizes, card.length)


def _card(header: dict[str, Any], path: Path) -> PolicyCard:
    known = {field.name for field in fields(PolicyCard)}
    try:
        control = ControlConfig(**header["control"])
        lengths = tuple(header["lengths"])
        there = {name: header[name] for name in known - LATER | known & header.keys()}
        own = tuple((name, value) for name, value in there.get("task_settings", ()))
        plain = {"control": control, "lengths": lengths, "task_settings": own}
        return PolicyCard(**{**there, **plain})
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path} has a header that does not describe a policy ({error})") from None
