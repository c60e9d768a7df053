"""`salpchain demo`."""

import shlex
from dataclasses import dataclass
from pathlib import Path

from salpchain.cli import train as train_command
from salpchain.cli.options import Flag, Folder, Lengths, Whole, positive
from salpchain.cli.outputs import check_new
from salpchain.cli.settings import File, Sets
from salpchain.cli.streams import say
from salpchain.evaluation.config import SUMMARY_FILE, parse_lengths, programs
from salpchain.files import make_writable, writing
from salpchain.installation import program
from salpchain.training import run_folder

SWIM_LENGTHS = (4, 8, 16, 32, 64)
PICTURES = ("learning.png", "learning.pdf", "zero-shot.png", "zero-shot.pdf", "chains.png")
SHOWN_SEED = 20  # of the starts in the picture; not those of the test


@dataclass(frozen=True)
class Demo:
    """Train on 8 units with the quick preset, test on 4 to 64, write figures and a table.

    Killed half way, the same command goes on from the last checkpoint.

    Example: salpchain demo --out demo
    """

    out: Folder = "demo"
    """Folder for the run, the evaluation and the figures."""
    seed: Whole = ""
    """Seed of the training. Default: 0."""
    steps: Whole = ""
    """Chain-steps of training. Default: the preset's."""
    lengths: Lengths = "4,8,16,24,32,40,48,56,64"
    """Lengths to test; 4:64:4 are the paper's."""
    trials: Whole = "20"
    """Episodes of each length; few, so that the demo takes minutes."""
    config: File = ""
    """Settings of the training from a file, as of salpchain train."""
    set: Sets = ()
    """Any setting of the training, as of salpchain train; may be given several times."""
    overwrite: Flag = False
    """Replace the evaluation and the pictures in --out, whatever they are of."""


def run(options: Demo) -> int:
    """The whole path."""
    folder = Path(options.out)
    lengths = parse_lengths(options.lengths)
    trials = positive("trials", options.trials)
    training = _training(options, folder / "run")
    if not (options.overwrite or (folder / "run" / run_folder.CONFIG_FILE).exists()):
        for name in (SUMMARY_FILE, *PICTURES):
            check_new(folder / name)
    make_writable(folder)
    with writing(folder / "demo"):
        status = train_command.run(training)
        if status:
            return status
        _test(folder, lengths, trials, options.overwrite)
        _draw(folder)
    return 0


def _training(options: Demo, run: Path) -> train_command.Train:
    """A new training, or one that was interrupted and goes on; its settings are checked."""
    resume = (run / run_folder.CONFIG_FILE).exists()
    asked = train_command.Train(
        out=str(run),
        config=options.config,
        set=options.set,
        seed=options.seed,
        steps=options.steps,
        resume=resume,
    )
    train_command.settings(asked, run)
    return asked


def _test(folder: Path, lengths: list[int], trials: int, overwrite: bool) -> None:
    from salpchain.cli.display import share_display
    from salpchain.cli.tables import show, table
    from salpchain.controllers.storage import load
    from salpchain.devices import use_devices
    from salpchain.evaluation.evaluate import evaluate

    use_devices()
    policy = load(folder / "run")
    with share_display("testing", programs(policy.card.control.model, lengths)) as watch:
        summary = evaluate(policy, lengths, trials, out=folder, progress=watch, overwrite=overwrite)
    show(table(summary))


def _draw(folder: Path) -> None:
    from salpchain.cli.display import share_display
    from salpchain.controllers.storage import load
    from salpchain.evaluation.recording import record
    from salpchain.report import figures, picture

    figures.learning_curves([folder / "run"], folder / "learning.png")
    figures.zero_shot([folder / "evaluation.json"], folder / "zero-shot.png")
    policy = load(folder / "run")
    with share_display("recording") as watch:
        swims = record(policy, SWIM_LENGTHS, seed=SHOWN_SEED, progress=watch)
    picture.chains_picture(swims, folder / "chains.png")
    print(f"wrote {folder}/learning.png, zero-shot.png, chains.png and evaluation.json")
    say(f"next: steer it yourself with  {program()} live {shlex.quote(str(folder / 'run'))}")
