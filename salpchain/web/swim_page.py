"""The swim page: one HTML file in which engine, policy and page swim without a server.

It is the live page with another line: what `static/line.js` asks of a server, `swim/` works out in
the browser. Drawing, tools and look are the live page's own files. Numbers that have a home in this
package are written into the page, so that none has a second one.
"""

import base64
import hashlib
import html
import json
from collections.abc import Mapping
from dataclasses import asdict, fields
from importlib.resources import files
from typing import Any

import numpy as np
from safetensors.numpy import save

from salpchain.checks import SHORTEST
from salpchain.controllers import greedy
from salpchain.controllers.policy import Policy
from salpchain.controllers.storage import KIND, VERSION, load
from salpchain.evaluation.suites import GRADES, SUITES
from salpchain.physics import broadphase, joints, obstacles
from salpchain.physics.sizes import LINK_LENGTH
from salpchain.physics.state import Physics
from salpchain.ranges import Range
from salpchain.report import replay
from salpchain.tasks.config import FIXED_LIMIT, GOAL_LIMIT
from salpchain.tasks.features import NEIGHBOUR, OBSERVATIONS, SENSED
from salpchain.trees import to_arrays
from salpchain.web import drawing, pool, recorder, swimmer, tank, world
from salpchain.web.troubles import CHOSEN_KIND, LENGTH, TROUBLES
from salpchain.world import current, placement
from salpchain.world.config import WorldConfig
from salpchain.world.presets import WORLDS

STATIC, SWIM, PAGE = (
    files(package) / folder
    for package, folder in (
        ("salpchain.web", "static"), ("salpchain.web", "swim"), ("salpchain.report", "page"),
    )
)  # fmt: skip
ENGINE = ("physics", "onnx", "policy", "pond", "sea", "recorder", "tank")  # in the worker too
SCRIPTS = (
    (PAGE, "drawing"), (PAGE, "surroundings"), (STATIC, "tools"), (STATIC, "recording"),
    (SWIM, "scenes"), (SWIM, "line"), (STATIC, "live"),
)  # fmt: skip
STYLES = ((PAGE, "look"), (STATIC, "live"), (SWIM, "swim"))
SERVED_WORLDS = ("still", "current", "vortex", "posts", "room", "failing", "noisy", "rough")
HERE = "<!-- swim.html comes here where the world swims in the browser itself -->\n"
TITLE = "Swim - salpchain"


def swim_page(policy: str = "any-water") -> str:
    """The page as HTML that needs no other file and no network, with this policy's weights.

    Raises:
        InputError: no such policy.
    """
    scripts = {"facts": f"const FACTS = {_json(facts())};", **_engine()}
    pages = {f"page-{name}": _read(folder, f"{name}.js") for folder, name in SCRIPTS}
    style = "\n".join(_read(folder, f"{name}.css") for folder, name in STYLES)
    head, _, body = _read(STATIC, "live.html").partition("</head>")
    icon = base64.b64encode((STATIC / "icon.svg").read_bytes()).decode()
    new_head = "\n".join(
        [
            '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            '<meta http-equiv="Content-Security-Policy" content="'
            + content_policy({**scripts, **pages}, style)
            + '">',
            f"<title>{html.escape(TITLE)}</title>",
            f'<link rel="icon" href="data:image/svg+xml;base64,{icon}">',
            f"<style>{style}</style>\n",
        ]
    )
    assert HERE in body and "<script" in head
    body = body.replace(HERE, _read(SWIM, "swim.html"))
    data = _data("weights", "text/plain", weights(load(policy)))
    data += _data("player-page", "application/json", _json(_player()))
    code = "".join(f"<script data-engine>{text}</script>\n" for text in scripts.values())
    code += "".join(f"<script>{text}</script>\n" for text in pages.values())
    main, end = body.split("</body>")
    return f"{new_head}</head>{main}{data}{code}</body>{end}"


def facts() -> dict[str, Any]:
    """What the page must know of this package: constants, bounds, observations, worlds."""
    physics = {one.name: getattr(Physics(), one.name) for one in fields(Physics)}
    return {
        "physics": {name: value for name, value in physics.items() if not isinstance(value, str)},
        "slack": broadphase.SLACK,
        "closed": joints.CLOSED,
        "log1p": joints.LOG1P,
        "harder": obstacles.HARDER,
        "deepest": obstacles.DEEPEST,
        "link": LINK_LENGTH,
        "goal": GOAL_LIMIT,
        "neighbour": NEIGHBOUR,
        "sensed": SENSED,
        "observations": {name: _layout(name) for name in OBSERVATIONS},
        "greedy": {"pull": greedy.PULL, "damping": greedy.DAMPING},
        "live": _bounds(),
        "recording": {"longest": recorder.LONGEST, "parts": recorder.MOST_PARTS},
        "lambOseen": current.SHAPE,
        "grades": GRADES,
        "worlds": {name: _settings(WORLDS[name]) for name in SERVED_WORLDS},
        "troubles": {
            name: [_trouble(name, grade) for grade in range(len(GRADES))] for name in TROUBLES
        },
    }


def _layout(observation: str) -> list[tuple[str, str, int]]:
    """For each feature its first number's name and unit, and how many numbers it has."""
    features = OBSERVATIONS[observation]
    return [(one.fields[0].name, one.fields[0].unit, len(one.fields)) for one in features]


def _bounds() -> dict[str, Any]:
    """What a person may do, and where things may be put."""
    return {
        "most": tank.MOST_UNITS,
        "shortest": SHORTEST,
        "first": world.FIRST_LENGTH,
        "chains": pool.CHAINS,
        "kick": world.HARDEST_KICK,
        "kickAmongWalls": world.KICKS_AMONG_WALLS,
        "current": world.FASTEST_CURRENT,
        "reach": swimmer.REACH,
        "room": swimmer.ROOM,
        "leans": swimmer.LEANS.tolist(),
        "sharpest": float(drawing.SHARPEST),
        "shortestLine": drawing.SHORTEST_LINE,
        "clear": tank.ROOM,
        "grain": tank.GRAIN,
        "limit": FIXED_LIMIT,
        "wall": placement.WIDTH,
        "narrowest": placement.NARROWEST,
        "tries": placement.TRIES,
    }


def _settings(config: WorldConfig) -> dict[str, Any]:
    """The settings of a world by path, ranges as [low, high]; of obstacles, water: all."""
    found = config.changes(WorldConfig())
    for name in ("obstacles", "current"):
        if any(path.startswith(f"{name}.") for path in found):
            part = getattr(config, name)
            own = {f"{name}.{one.name}": getattr(part, one.name) for one in fields(part)}
            found |= {path: value for path, value in own.items() if value.most > 0}
    return {path: _plain(value) for path, value in found.items()}


def _trouble(name: str, grade: int) -> dict[str, Any]:
    """What a trouble of the live page changes at a grade."""
    kinds: Mapping[str, WorldConfig] = SUITES["sea"].troubles[name](grade, LENGTH)
    chosen = [CHOSEN_KIND[name]] if name in CHOSEN_KIND else list(kinds)
    return {path: value for kind in chosen for path, value in _settings(kinds[kind]).items()}


def _plain(value: Any) -> Any:
    return [value.low, value.high] if isinstance(value, Range) else value


def weights(policy: Policy) -> str:
    """The policy's file in half precision, without its critics, which do not swim: base64."""
    arrays = {
        name: np.asarray(array, np.float16)
        for name, array in to_arrays(policy.network).items()
        if {"trunk", "actor"} & set(name.split(".")[:2])  # of two networks by jet, of each
    }
    header = {"kind": KIND, "version": VERSION, "header": asdict(policy.card)}
    file = save(arrays, metadata={"salpchain": json.dumps(header)})
    return base64.b64encode(file).decode()


def content_policy(scripts: Mapping[str, str], style: str) -> str:
    """Its own scripts and style, a worker and a replay made of them, and nothing of other hosts."""
    own = " ".join(_digest(text) for text in scripts.values())
    played = replay.content_policy().split("; ")
    scripts_too = next(part for part in played if part.startswith("script-src "))[11:]
    style_too = next(part for part in played if part.startswith("style-src "))[10:]
    return (
        f"default-src 'none'; script-src {own} {scripts_too};"
        f" style-src {_digest(style)} {style_too}; img-src data:; worker-src blob:;"
        " frame-src blob:; base-uri 'none'; form-action 'none'"
    )


def _player() -> list[str]:
    """The replay page before and after its data."""
    mark = "data-of-the-recording"
    text = replay.filled("Recorded on the swim page - salpchain replay", {"mark": mark})
    data = next(line for line in text.splitlines() if mark in line)
    inner = data.partition(">")[2].rpartition("<")[0]
    before, after = text.split(inner)
    return [before, after]


def _engine() -> dict[str, str]:
    return {name: _read(SWIM, f"{name}.js") for name in ENGINE}


def _data(name: str, kind: str, text: str) -> str:
    """A block of data; no browser runs it."""
    return f'<script type="{kind}" id="{name}">{text}</script>\n'


def _json(value: Any) -> str:
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _digest(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def _read(folder: Any, name: str) -> str:
    return (folder / name).read_text(encoding="utf-8")
