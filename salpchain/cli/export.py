"""`salpchain export`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from salpchain.checks import one_of
from salpchain.cli.options import Flag, Name, text_option
from salpchain.cli.outputs import write_new
from salpchain.errors import InputError
from salpchain.files import writing
from salpchain.interop import FORMATS


@dataclass(frozen=True)
class Export:
    """Write a policy as one file that runs without JAX.

    onnx: any ONNX runtime runs it (extra onnx). torch: a plain PyTorch module, read by
    salpchain.interop.network.load_torch (extra torch). Both take any number of chains and units,
    clip inside, and say what each number of the observation is.

    Example: salpchain export any-length --format onnx --out salps.onnx
    """

    policy: tyro.conf.Positional[Annotated[str, text_option("POLICY")]] = ""
    """A run folder, a policy.safetensors, or a released policy that `salpchain models` lists.
    A name wins over a folder that is called so: write ./NAME for the folder."""
    format: Name = "onnx"
    """onnx or torch."""
    out: Annotated[str, text_option("FILE")] = ""
    """The file. Default: the policy's name in the working folder."""
    overwrite: Flag = False
    """Replace the file if it exists and holds something else."""


def run(options: Export) -> None:
    """Writes the file."""
    one_of("format", options.format, FORMATS)
    if not options.policy:
        raise InputError("salpchain export needs a policy, e.g. any-length, or a run folder")
    from salpchain.controllers.storage import load
    from salpchain.interop.export import export

    policy = load(options.policy)
    suffix = FORMATS[options.format]
    out = Path(options.out or f"{policy.card.name}{suffix}")
    if out.suffix != suffix:
        raise InputError(f"--out must end in {suffix} for --format {options.format}, got {out}")
    if out.exists() and out.resolve() in _of(Path(options.policy)):
        raise InputError(f"--out {out} is the policy itself: choose another file")
    with writing(out):
        write_new([out], options.overwrite, lambda path: export(policy, path, options.format))
    print(f"wrote {out} ({out.stat().st_size / 1e6:.2f} MB)")


def _of(policy: Path) -> list[Path]:
    return [policy.resolve(), (policy / "policy.safetensors").resolve()]
