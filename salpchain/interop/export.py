"""Policies as files for other tools."""

from importlib import import_module
from pathlib import Path

from salpchain.control.policy import Policy
from salpchain.interop.layout import metadata
from salpchain.trees import to_arrays


def export(policy: Policy, path: Path, kind: str) -> None:
    """The policy as one file of this kind, `onnx` or `torch`.

    Raises:
        InputError: its extra is not installed.
        OSError: the folder is missing or not writable, or the disk is full.
    """
    if kind == "onnx":
        import_module("salpchain.interop.onnx").export_onnx(policy, path)
    else:
        save = import_module("salpchain.interop.network").save_torch
        save(to_arrays(policy.network), metadata(policy.card), path)
