"""`salpchain figure`."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import tyro

from salpchain.checks import one_of
from salpchain.cli.options import Flag, text_option
from salpchain.cli.outputs import write_new
from salpchain.errors import InputError
from salpchain.files import writing

KINDS = ("learning", "zero-shot")
SUFFIXES = (".png", ".pdf")


@dataclass(frozen=True)
class Figure:
    """Draw learning curves of runs, or zero-shot curves of evaluations, as PNG and PDF.

    learning takes run folders: lines are success in training, diamonds the deterministic
    evaluations on the way and at the end. Runs that differ in their seed alone are averaged (mean
    and standard error). zero-shot takes folders with an evaluation.json, or such files.

    Example: salpchain figure zero-shot results/eight --out figures/zero-shot.png
    """

    kind: tyro.conf.Positional[Annotated[str, text_option("learning|zero-shot")]] = ""
    """What to draw."""
    sources: tyro.conf.Positional[Annotated[tuple[str, ...], text_option("FOLDER")]] = ()
    """Run folders (learning), or evaluations (zero-shot)."""
    out: Annotated[str, text_option("FILE.png")] = ""
    """The picture; the PDF is written beside it. Default: KIND.png in the working folder."""
    overwrite: Flag = False
    """Replace pictures that exist and show something else."""


def run(options: Figure) -> None:
    """Draws the figure."""
    if not options.kind:
        raise InputError(
            f"salpchain figure needs what to draw, {' or '.join(KINDS)}, and folders,"
            " e.g. learning runs/eight"
        )
    one_of("figure", options.kind, KINDS)
    if not options.sources:
        raise InputError(f"salpchain figure {options.kind} needs at least one folder to draw")
    out = Path(options.out or f"{options.kind}.png")
    if out.suffix not in SUFFIXES:
        raise InputError(f"--out must end in .png or .pdf, got {options.out}")
    if not out.parent.is_dir():
        raise InputError(f"no such folder for --out: {out.parent}")
    from salpchain.report import figures

    paths = [Path(source) for source in options.sources]
    if options.kind == "learning":
        draw = partial(figures.learning_curves, paths)
    else:
        draw = partial(figures.zero_shot, [evaluation_file(path) for path in paths])
    both = [out.with_suffix(suffix) for suffix in SUFFIXES]
    with writing(both[0]):  # and the PDF, which goes with it
        write_new(both, options.overwrite, draw)
    print(f"wrote {both[0]} and {both[1]}")


def evaluation_file(path: Path) -> Path:
    """The evaluation.json that a path on the command line means.

    Raises:
        InputError: there is none.
    """
    places = [path, path / "evaluation.json", path / "evaluation" / "evaluation.json"]
    for place in places:
        if place.is_file():
            return place
    raise InputError(f"{path} has no evaluation.json: make one with salpchain evaluate")
