"""Policies as files for other tools."""

from importlib import import_module

import jax
import numpy as np

from salpchain.checks import one_of
from salpchain.controllers import named
from salpchain.controllers.policy import Controller, Policy
from salpchain.controllers.storage import network_shapes
from salpchain.errors import InputError
from salpchain.files import StrPath
from salpchain.given import path as checked_path
from salpchain.given import told
from salpchain.interop import FORMATS
from salpchain.interop.metadata import metadata
from salpchain.networks.config import MODELS
from salpchain.trees import to_arrays

GRAPHS = ("mixed", "full", "near", "hub")  # that both formats have


def export(policy: Controller | StrPath, path: StrPath, kind: str) -> None:
    """The policy, or that of this name or path, as one file of this kind, `onnx` or `torch`.

    Raises:
        InputError: no such kind, no learned policy, a network that is not the one its card names,
            or the extra is not installed.
        OSError: the folder is missing or not writable, or the disk is full.
    """
    one_of("format", kind, FORMATS)
    learned = named.controller(policy)
    if not isinstance(learned, Policy):
        raise InputError(f"only a learned policy can be exported, got {told(policy)}")
    _check_known(learned)
    path = checked_path("path", path)
    if kind == "onnx":
        import_module("salpchain.interop.onnx").export_onnx(learned, path)
    else:
        save = import_module("salpchain.interop.network").save_torch
        save(to_arrays(learned.network), metadata(learned.card), path)


def _check_known(policy: Policy) -> None:
    """Raise InputError unless the network is that of the settings on its card.

    The formats have the layers of those networks alone; any other would be written wrongly.
    """
    card = policy.card
    if card.control.model not in MODELS:
        raise InputError(
            f"only the models {', '.join(MODELS)} can be exported, {card.name} is one of your own,"
            f" {card.control.model}"
        )
    if card.control.memory:
        raise InputError(
            f"only policies that remember nothing can be exported, the units of {card.name} have"
            " memory"
        )
    if card.control.by_jet:
        raise InputError(
            f"only policies of one network can be exported, {card.name} has two, by what jet a unit"
            " has"
        )
    if card.control.graph not in GRAPHS:
        raise InputError(
            f"only the graphs {', '.join(GRAPHS)} can be exported, {card.name} has the graph"
            f" {card.control.graph}"
        )
    known, network = network_shapes(card), policy.network
    alike = jax.tree.structure(known) == jax.tree.structure(network)
    if not alike or [x.shape for x in jax.tree.leaves(known)] != [
        np.shape(x) for x in jax.tree.leaves(network)
    ]:
        raise InputError(
            f"only the networks of salpchain can be exported, as their card names them: the card of"
            f" {policy.card.name} names {policy.card.control.model}, its network is another"
            f" ({type(network).__name__})"
        )
