"""Folders of results: whose they are, and tables that grow part by part.

OUT/report.md             what a reader wants to know
OUT/results/about.json    which experiment, of which policy, with which settings
OUT/results/*             what was measured
"""

import atexit
import hashlib
import json
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pandas as pd

from salpchain.controllers.policy import Policy
from salpchain.errors import InputError
from salpchain.files import StrPath, make_writable, read_json, write_json, write_text, writing

ABOUT_FILE = "about.json"
REPORT_FILE = "report.md"
RESULTS = "results"  # folder beside the report

_claimed: set[Path] = set()  # folders of this process, until it ends
_held = ExitStack()
atexit.register(_held.close)


def results_of(out: StrPath) -> Path:
    """OUT/results, where the results of a study in OUT lie.

    Raises:
        InputError: they lie in OUT itself.
    """
    out = Path(out)
    if (out / ABOUT_FILE).exists():
        raise InputError(
            f"{out} holds results itself, where a study has them in {RESULTS}/: give the folder"
            f" above it, or move all but {REPORT_FILE} to {out / RESULTS}"
        )
    return out / RESULTS


def claim(out: StrPath, study: str, policy: Policy | None = None, **settings: Any) -> None:
    """The folder for a study's results, of this policy if of one; `about.json` keeps all of it.

    Raises:
        InputError: it holds results of another study or policy, or with other settings; or another
            process is at it.
        OSError: it cannot be made or written.
    """
    out, about = Path(out), {"study": study}
    if policy is not None:
        weights = b"".join(np.asarray(x).tobytes() for x in jax.tree.leaves(policy.network))
        about |= {"policy": policy.card.name, "weights": hashlib.sha256(weights).hexdigest()}
    mine = json.loads(json.dumps(about | settings))
    make_writable(out)
    if out.resolve() not in _claimed:
        _held.enter_context(writing(out / ABOUT_FILE))
        _claimed.add(out.resolve())
    kept = read_json(out / ABOUT_FILE) if (out / ABOUT_FILE).exists() else {}
    if not isinstance(kept, dict):
        raise InputError(f"{out / ABOUT_FILE} is damaged: choose another folder")
    if not kept and not any(out.glob("*.csv")):
        write_json(out / ABOUT_FILE, mine)
    elif kept != mine:
        odd = next((key for key in mine if kept.get(key) != mine[key]), "study")
        raise InputError(
            f"{out} holds other results: {odd} is {kept.get(odd, 'unknown')} there, {mine[odd]} was"
            " given; choose another folder"
        )


def add_part(path: StrPath, part: dict[str, Any], play: Callable[[], pd.DataFrame]) -> None:
    """The rows of this part, added to the CSV file unless they are there.

    Raises:
        InputError: the file holds something else.
    """
    path = Path(path)
    try:
        known = pd.read_csv(path) if path.exists() else None
        if known is not None and np.all(known[list(part)] == pd.Series(part), axis=1).any():
            return
    except (pd.errors.ParserError, pd.errors.EmptyDataError, UnicodeDecodeError, KeyError):
        raise InputError(f"{path} is damaged: remove it, or choose another folder") from None
    print(", ".join(f"{key} {value}" for key, value in part.items()), flush=True)
    whole = pd.concat([frame for frame in (known, play()) if frame is not None])
    write_text(path, whole.to_csv(index=False))
