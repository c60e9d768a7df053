"""Policies as files for other tools."""

from importlib import import_module
from pathlib import Path

from salpchain.control.policy import Controller, Policy
from salpchain.domain.config import one_of
from salpchain.errors import InputError
from salpchain.files import StrPath
from salpchain.interop import FORMATS
from salpchain.interop.layout import metadata
from salpchain.trees import to_arrays


def export(policy: Controller, path: StrPath, kind: str) -> None:
    """The policy as one file of this kind, `onnx` or `torch`.

    Raises:
        InputError: no such kind, no learned policy, or its extra is not installed.
        OSError: the folder is missing or not writable, or the disk is full.
    """
    one_of("format", kind, FORMATS)
    if not isinstance(policy, Policy):
        raise InputError(f"only a learned policy can be exported, got {policy!r:.60}")
    path = Path(path)
    if kind == "onnx":
        import_module("salpchain.interop.onnx").export_onnx(policy, path)
    else:
        save = import_module("salpchain.interop.network").save_torch
        save(to_arrays(policy.network), metadata(policy.card), path)
