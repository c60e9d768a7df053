"""The replay page: trajectories in one HTML file that needs no network."""

import base64
import hashlib
import html
import json
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool

from salpchain import given
from salpchain.errors import InputError
from salpchain.evaluation.surroundings import Surroundings
from salpchain.evaluation.trajectory import Trajectory, as_swims
from salpchain.files import StrPath, write_text
from salpchain.report.shapes import UNIT
from salpchain.report.surroundings import is_moving

MOST = 12  # trajectories in a page (chosen; more are too small to be seen)
FOLDER = files("salpchain.report") / "page"
SCRIPTS = {
    "drawing": "drawing.js",
    "surroundings": "surroundings.js",
    "curves": "curves.js",
    "recorded": "recorded.js",
    "script": "replay.js",
}


def write_replay(swims: Trajectory | Sequence[Trajectory], out: StrPath) -> Path:
    """The page with these trajectories side by side; returns its path.

    Raises:
        InputError: no trajectories, or more than a page shows.
        OSError: the folder is missing or not writable, or the disk is full.
    """
    swims, out = as_swims(swims), given.path("out", out)
    if len(swims) > MOST:
        raise InputError(f"a replay shows 1 to {MOST} trajectories, got {len(swims)}")
    write_text(out, page(swims))
    return out


def page(swims: Sequence[Trajectory]) -> str:
    """The HTML. Names and numbers are in it as data; no script is made from them."""
    return filled(f"{swims[0].policy} - salpchain replay", {"swims": [packed(s) for s in swims]})


def filled(title: str, data: dict[str, Any]) -> str:
    """The page with this title and data."""
    data = {**data, "sizes": {"unit": UNIT}}
    words = _parts() | {
        "policy": content_policy(),
        "title": html.escape(title),
        "data": _inert(json.dumps(data)),
    }
    text = read("replay.html")
    for name, word in words.items():
        text = text.replace("{{" + name + "}}", word, 1)
    return text


def content_policy() -> str:
    """The Content-Security-Policy of a page: its own scripts and style, nothing from anywhere."""
    parts = _parts()
    scripts = " ".join(_digest(parts[name]) for name in SCRIPTS)
    return f"default-src 'none'; script-src {scripts}; style-src {_digest(parts['style'])}"


def _parts() -> dict[str, str]:
    """What every page holds, by its name in the HTML."""
    scripts = {name: read(file) for name, file in SCRIPTS.items()}
    return scripts | {"style": read("look.css") + read("replay.css")}


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
    about = ("policy", "seed", "trial", "time_limit", "length", "steps", "success", "world", "task")
    scale = Scale.of(swim.unit_position, swim.target)
    moving = {"moving": scale.numbers(swim.targets)} if swim.target_moves else {}
    return {
        **{name: getattr(swim, name) for name in about},
        "dt": round(swim.dt, 9),
        "target": np.round(swim.targets[0].astype(float), 4).tolist(),
        **moving,
        **({} if swim.unit_size == UNIT else {"unit": swim.unit_size}),
        **packed_hinges(swim),
        **packed_surroundings(swim.around, swim.length),
        **packed_cuts(swim.parted),
        **scale.packed(),
        **packed_motion(scale, swim.unit_position, swim.unit_angle, swim.thrust, swim.distance),
    }


def packed_surroundings(around: Surroundings, length: int) -> dict[str, Any]:
    """Walls and posts (m), from which step each thruster is dead, the water in 8 bits; what there
    is none of is left out."""
    known: dict[str, Any] = {}
    for name in ("walls", "posts"):
        if len(rows := getattr(around, name)):
            known[name] = np.round(rows.astype(float), 4).tolist()
    if len(around.gain):
        dead = around.gain == 0
        known["dead"] = [int(one.argmax()) if one.any() else None for one in dead.T[:length]]
    if is_moving(around):
        speed = float(np.abs(around.water).max())
        known["water"] = {
            "shape": around.water.shape[:3],
            "area": around.water_area.astype(float).tolist(),
            "speed": speed,
            "flow": _numbers(around.water / speed * 127, "<i1"),
        }
    return known


def packed_hinges(swim: Trajectory) -> dict[str, Any]:
    """Of units that are rigid links: how long they are (m), and their mounts (rad)."""
    if not swim.is_rigid:
        return {}
    return {"link": swim.link_length, "mounts": np.round(swim.mounts, 5).tolist()}


def packed_cuts(parted: Bool[np.ndarray, "time link"]) -> dict[str, Any]:
    """From and until which step links are cut, as (link, first, last); nothing of whole chains."""
    edges = np.diff(parted.astype(int), axis=0, prepend=0, append=0)
    cuts = [
        [link, int(first), int(last) - 1]
        for link, column in enumerate(edges.T)
        for first, last in zip(*(np.flatnonzero(column == k) for k in (1, -1)), strict=True)
    ]
    return {"cuts": cuts} if cuts else {}


class Scale(NamedTuple):
    """How positions are put into 16 bits."""

    middle: np.ndarray  # (2,) m
    grain: float  # m

    @classmethod
    def of(cls, *points: np.ndarray) -> "Scale":
        """The finest scale for all these points (..., 2) in metres."""
        every = np.concatenate([np.reshape(each, (-1, 2)) for each in points]).astype(float)
        low, high = every.min(axis=0), every.max(axis=0)
        return cls((low + high) / 2, max(float((high - low).max()), 1e-3) / 65000)

    def packed(self) -> dict[str, Any]:
        """The scale as JSON."""
        return {"middle": self.middle.tolist(), "grain": self.grain}

    def numbers(self, points: np.ndarray) -> str:
        """Points (m) in 16 bits."""
        return _numbers((points - self.middle) / self.grain, "<i2")


def packed_motion(
    scale: Scale, position: np.ndarray, angle: np.ndarray, thrust: np.ndarray, distance: np.ndarray
) -> dict[str, Any]:
    """Positions (time, unit, 2) m, angles (rad), thrusts (N), mean distances (m) as JSON."""
    wrapped = np.mod(angle + np.pi, 2 * np.pi) - np.pi
    return {
        "position": scale.numbers(position),
        "angle": _numbers(wrapped / np.pi * 32767, "<i2"),
        "thrust": _numbers(np.clip(thrust, -1, 1) * 127, "<i1"),
        "distance": base64.b64encode(distance.astype("<f4").tobytes()).decode(),
    }


def _numbers(values: np.ndarray, kind: str) -> str:
    return base64.b64encode(np.round(values).astype(kind).tobytes()).decode()
