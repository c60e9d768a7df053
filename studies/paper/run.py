"""Do the paper's claims hold? Preset `quick`, 3 seeds each: python -m studies.paper.run OUT

`salpchain reproduce --preset quick --seeds 3 --out OUT/results`, which writes its report to
OUT/results/report/. What is there is kept: stopped, it goes on.
"""

import sys
from pathlib import Path

from salpchain.cli.main import run
from salpchain.errors import InputError
from salpchain.experiments.results import RESULTS
from studies import program


def main() -> None:
    """Repeats the paper into the folder that the command line names."""
    if len(sys.argv) != 2:
        raise InputError("give a folder: python -m studies.paper.run OUT")
    out = str(Path(sys.argv[1]) / RESULTS)
    sys.exit(run(["reproduce", "--preset", "quick", "--seeds", "3", "--out", out]))


if __name__ == "__main__":
    program("paper", main, __doc__)
