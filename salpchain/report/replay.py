"""The replay page: trajectories in one HTML file that needs no network."""

import base64
import hashlib
import html
import json
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from salpchain.errors import InputError
from salpchain.evaluation.trajectory import Trajectory
from salpchain.files import StrPath, write_text

MOST = 12  # trajectories in a page (chosen; more are too small to be seen)
FOLDER = files("salpchain.report") / "page"


def write_replay(swims: Sequence[Trajectory], out: StrPath) -> Path:
    """The page with these trajectories side by side; returns its path.

    Raises:
        InputError: no trajectories, or more than a page shows.
        OSError: the folder is missing or not writable, or the disk is full.
    """
    if not 1 <= len(swims) <= MOST:
        raise InputError(f"a replay shows 1 to {MOST} trajectories, got {len(swims)}")
    write_text(out, page(swims))
    return Path(out)


def page(swims: Sequence[Trajectory]) -> str:
    """The HTML. Names and numbers are in it as data; no script is made from them."""
    parts = {
        "style": read("look.css") + read("replay.css"),
        "drawing": read("drawing.js"),
        "curves": read("curves.js"),
        "script": read("replay.js"),
    }
    scripts = " ".join(_digest(parts[name]) for name in ("drawing", "curves", "script"))
    words = parts | {
        "policy": f"default-src 'none'; script-src {scripts}; style-src {_digest(parts['style'])}",
        "title": html.escape(f"{swims[0].policy} - salpchain replay"),
        "data": _inert(json.dumps({"swims": [packed(swim) for swim in swims]})),
    }
    text = read("replay.html")
    for name, word in words.items():
        text = text.replace("{{" + name + "}}", word, 1)
    return text


def read(name: str) -> str:
    """A file of the pages."""
    return (FOLDER / name).read_text(encoding="utf-8")


def _digest(text: str) -> str:
    """How a page's policy names a script or style that it allows."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def _inert(text: str) -> str:
    """JSON that ends no script, whatever it holds."""
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def packed(swim: Trajectory) -> dict[str, Any]:
    """A trajectory as JSON: positions and angles in 16 bits, thrusts in 8.

    Over 10 m the grain of positions is 0.15 mm.
    """
    low, high = swim.unit_position.min(axis=(0, 1)), swim.unit_position.max(axis=(0, 1))
    middle, grain = (low + high) / 2, max(float((high - low).max()), 1e-3) / 65000
    wrapped = np.mod(swim.unit_angle + np.pi, 2 * np.pi) - np.pi
    about = ("policy", "seed", "trial", "time_limit", "length", "steps", "success")
    return {
        **{name: getattr(swim, name) for name in about},
        "dt": round(swim.dt, 9),
        "target": np.round(swim.target.astype(float), 4).tolist(),
        "middle": middle.astype(float).tolist(),
        "grain": grain,
        "position": _numbers((swim.unit_position - middle) / grain, "<i2"),
        "angle": _numbers(wrapped / np.pi * 32767, "<i2"),
        "thrust": _numbers(np.clip(swim.thrust, -1, 1) * 127, "<i1"),
        "distance": base64.b64encode(swim.distance.astype("<f4").tobytes()).decode(),
    }


def _numbers(values: np.ndarray, kind: str) -> str:
    return base64.b64encode(np.round(values).astype(kind).tobytes()).decode()
