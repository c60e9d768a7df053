"""`salpchain best`."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from salpchain.cli.options import Flag, number, text_option
from salpchain.cli.outputs import check_new
from salpchain.cli.recordings import check_out
from salpchain.errors import InputError
from salpchain.evaluation.best import solutions, starts
from salpchain.evaluation.config import parse_lengths
from salpchain.files import write_text, writing

if TYPE_CHECKING:
    from salpchain.evaluation.best.solutions import Found
    from salpchain.evaluation.trajectory import Trajectory

SUFFIXES = (".png", ".html", ".gif", ".mp4", ".npz")
GAPS_SUFFIXES = (".png", ".csv")


@dataclass(frozen=True)
class Best:
    """Show the best-known solutions: for fixed starts the fewest control steps that are known.

    There are 100 starts at each of 2, 3, 4, 6, 8, 12, 16 and 32 units. The table has the medians of
    the steps, of the lower bound that no chain can beat, and of what any-length takes. Solutions
    can be replayed, looked at, and replaced by better ones: docs/best.md.

    Example: salpchain best --check --lengths 2,3,4

    Example: salpchain best --play 8 12 --out swim.html

    Example: salpchain best --gaps --out gaps.png

    Example: salpchain best --add mine.npz --who "A. Name" --how "direct collocation"
    """

    check: Flag = False
    """Replay all solutions in the engine: exit status 1 if one misses its target."""
    vmas: Flag = False
    """With --check: in the real VMAS too, which must be installed."""
    play: Annotated[tuple[str, ...], text_option("LENGTH START")] = ()
    """The length and the number (0 to 99) of a start: swim its solution, and write it to --out."""
    out: Annotated[str, text_option("FILE")] = ""
    """With --play: a picture (.png), a page (.html), a video (.gif, .mp4), a trajectory (.npz).
    With --gaps: a picture (.png), a table (.csv)."""
    add: Annotated[str, text_option("FILE.npz")] = ""
    """A solution to check, and to keep if it has fewer steps: arrays length, start, thrusts (step,
    unit) in N; or what salpchain rollout --seed 3030 wrote, its trial the start."""
    who: Annotated[str, text_option("TEXT")] = ""
    """With --add: who found it."""
    how: Annotated[str, text_option("TEXT")] = ""
    """With --add: how it was found."""
    gaps: Flag = False
    """Write to --out how far the solution of each start is from the lower bound."""
    lengths: Annotated[str, text_option("N,N,...")] = ""
    """Of the table, the check and the gaps. Default: all."""
    folder: Annotated[str, text_option("FOLDER")] = ""
    """Where the solutions are. Default: those that come with the package."""
    overwrite: Flag = False
    """Replace the file --out if it exists."""


def run(options: Best) -> int:
    """Shows the table, or does what was asked for."""
    _check_apart(options)
    folder = Path(options.folder or starts.FOLDER)
    if not folder.is_dir():
        raise InputError(f"no such folder: {folder}")
    if options.play:
        return _play(options, folder)
    if options.add:
        return _add(options, folder)
    lengths = _lengths(options.lengths)
    known = {length: solutions.load(length, folder) for length in lengths}
    from salpchain.devices import use_devices

    use_devices(1)
    if options.check:
        return _check(known, options.vmas)
    if options.gaps:
        return _gaps(options, known, folder)
    _table(known, folder)
    return 0


ASKED = ("check", "play", "add", "gaps")
WITH = {
    "vmas": ("check",),
    "out": ("play", "gaps"),
    "who": ("add",),
    "how": ("add",),
    "overwrite": ("play", "gaps"),
}


def _check_apart(options: Best) -> None:
    """Raise InputError if options do not go together."""
    asked = [name for name in ASKED if getattr(options, name)]
    if len(asked) > 1:
        ways = f"{', '.join(f'--{name}' for name in ASKED[:-1])} and --{ASKED[-1]}"
        raise InputError(f"choose one of {ways}, got --{' and --'.join(asked)}")
    for name, needs in WITH.items():
        if getattr(options, name) and not set(needs) & set(asked):
            raise InputError(f"--{name} goes with --{' or --'.join(needs)}")
    if options.lengths and asked in (["play"], ["add"]):
        raise InputError(
            f"--lengths goes with the table, --check and --gaps, not with --{asked[0]}"
        )


def _lengths(text: str) -> list[int]:
    lengths: list[int] = list(dict.fromkeys(parse_lengths(text) if text else starts.LENGTHS))
    for length in lengths:
        starts.check_place(length, 0)
    return lengths


def _table(known: dict[int, "Found"], folder: Path) -> None:
    """Prints a line for each length."""
    from salpchain.evaluation.best.table import row

    print(f"best-known solutions of {starts.STARTS} starts each: medians of control steps")
    _line("units", "known", "best", "bound", "bound/best", "any-length/best")
    for length, found in known.items():
        one = row(length, found, folder)
        steps = _cell(one.best, "g"), _cell(one.bound, "g")
        _line(length, one.known, *steps, *(_cell(x, ".3f") for x in (one.tightness, one.regret)))


WIDTHS = (5, 6, 7, 7, 11, 16)


def _line(*cells: object) -> None:
    print(" ".join(f"{cell:>{width}}" for cell, width in zip(cells, WIDTHS, strict=True)))


def _cell(value: float | None, form: str) -> str:
    return "-" if value is None else f"{value:{form}}"


def _check(known: dict[int, "Found"], in_vmas: bool) -> int:
    """Replays all solutions, prints what came of them; 1 if one misses its target."""
    judges = [("the engine", _in_engine)]
    if in_vmas:
        from salpchain.interop.best import SLACK
        from salpchain.interop.best import in_vmas as other

        judges.append((f"VMAS, within {1000 * SLACK:g} mm of the goal", other))
    missed = 0
    for length, found in known.items():
        for name, judge in judges:
            if not found:
                print(f"{length} units: no solution is known")
                break
            wrong = judge(length, found)
            missed += len(wrong)
            about = f", missed: {', '.join(map(str, wrong))}" if wrong else ""
            print(f"{length} units: {len(found) - len(wrong)} of {len(found)} in {name}{about}")
    return 1 if missed else 0


def _gaps(options: Best, known: dict[int, "Found"], folder: Path) -> int:
    """Writes what the solutions of each start need beside the bound."""
    out = check_out(options.out, GAPS_SUFFIXES, "best --gaps")
    if not options.overwrite:
        check_new(out)
    some = {length: found for length, found in known.items() if found}
    if not some:
        raise InputError(f"no solution is known in {folder}: there are no gaps to write")
    import pandas as pd

    from salpchain.evaluation.best.table import each_start
    from salpchain.report.gaps import gaps_picture

    gaps = pd.concat([each_start(length, found, folder) for length, found in some.items()])
    with writing(out):
        if out.suffix == ".csv":
            write_text(out, gaps.to_csv(index=False, float_format="%g"))
        else:
            gaps_picture(gaps, out)
    print(f"wrote {out}")
    return 0


def _in_engine(length: int, found: "Found") -> list[int]:
    """The starts whose solutions do not take the target in their steps."""
    from salpchain.evaluation.best.play import replay

    numbers = sorted(found)
    places = [(length, number) for number in numbers]
    steps = replay(places, [found[number].newtons for number in numbers]).steps
    return [number for number, count in zip(numbers, steps, strict=True) if not count]


def _play(options: Best, folder: Path) -> int:
    """Swims one solution, and writes it."""
    if len(options.play) != 2:
        raise InputError("--play needs a length and the number of a start, such as --play 8 12")
    length, start = (number("play", word) for word in options.play)
    starts.check_place(length, start)
    out = check_out(options.out, SUFFIXES, "best --play") if options.out else None
    found = solutions.load(length, folder)
    if start not in found:
        raise InputError(f"no solution is known of start {start} of {length} units")
    if out and not options.overwrite:
        check_new(out)
    from salpchain.devices import use_devices

    use_devices(1)
    from salpchain.evaluation.best.play import swim

    made, solution = swim(length, start, found[start]), found[start]
    end = "goal reached" if made.success else "goal not reached"
    print(f"start {start} of {length} units: {end} after {made.steps} steps, {solution.how}"
          f" ({solution.who})")  # fmt: skip
    if out:
        with writing(out):
            _write(made, out)
        print(f"wrote {out}")
    return 0


def _write(made: "Trajectory", out: Path) -> None:
    if out.suffix == ".npz":
        made.save(out)
    elif out.suffix == ".html":
        from salpchain.report.replay import write_replay

        write_replay(made, out)
    elif out.suffix == ".png":
        from salpchain.report.picture import chains_picture

        chains_picture(made, out)
    else:
        from salpchain.report.video import write_video

        write_video(made, out)


def _add(options: Best, folder: Path) -> int:
    """Checks a solution, and keeps it if it is better."""
    for name in ("who", "how"):
        if not getattr(options, name):
            raise InputError(f"salpchain best --add needs --{name}")
    offer = solutions.read_offer(options.add, options.who, options.how)
    from salpchain.devices import use_devices

    use_devices(1)
    from salpchain.evaluation.best.play import judged

    offer = judged(offer)
    before = solutions.load(offer.length, folder).get(offer.start)
    kept = solutions.keep(offer.length, {offer.start: offer.solution}, folder)
    new = kept[offer.start] is offer.solution
    known = "nothing was known" if before is None else f"{before.steps} were known"
    place = f"start {offer.start} of {offer.length} units"
    print(f"{place}: {offer.solution.steps} steps, {known}: {'kept' if new else 'not kept'}")
    return 0
