"""The look of a chain as outlines in metres, and its colours: what every picture shares."""

from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from salpchain.evaluation.trajectory import Trajectory
from salpchain.physics.sizes import UNIT_LENGTH, UNIT_WIDTH

# Seaborn's and Matplotlib's maps end in colours lost on water: this one runs from deep sea to sun.
PLACES = ("#22c3d6", "#3fd79a", "#b9e04f", "#ffc54a", "#ff8a5c", "#f7609f")
UNIT = (UNIT_LENGTH, UNIT_WIDTH)  # m, along the chain and across it
CORNER = 0.4  # of its shorter side, radius of a unit's corners (chosen)
LINK_WIDTH = 0.012  # m (chosen)
JET = 0.075  # m, length of the jet of 1 N (chosen)
FAINTEST = 0.005  # N, a thrust below which nothing is drawn (chosen; pages tell 0.01 N apart)
SHORTEST_JET = 0.25  # of a whole jet, so that every thrust that is drawn is seen (chosen)
DETAIL = 5  # points in a quarter of a circle (chosen)
REACHED = 0.0513  # m, how near each unit must be: the goal's distance

Points = Float[np.ndarray, "point 2"]
Outlines = Float[np.ndarray, "unit corner 2"]
Size = tuple[float, float]


def place_colours(count: int) -> Float[np.ndarray, "unit 3"]:
    """Red, green and blue in [0, 1] of each place in a chain, from the first unit to the last."""
    known = np.array([[int(c[i : i + 2], 16) / 255 for i in (1, 3, 5)] for c in PLACES])
    at = np.linspace(0, len(known) - 1, count)
    columns = [np.interp(at, np.arange(len(known)), column) for column in known.T]
    return np.stack(columns, axis=1)


def unit_outlines(
    position: Points, angle: Float[np.ndarray, " unit"], unit: Size = UNIT
) -> Outlines:
    """Rounded boxes (m), each unit in its true size (m) and turned with its angle."""
    quarter = np.linspace(0, np.pi / 2, DETAIL)
    bow = np.concatenate([quarter + k * np.pi / 2 for k in range(4)])
    signs = np.repeat([[1, 1], [-1, 1], [-1, -1], [1, -1]], DETAIL, axis=0)
    corner = CORNER * min(unit)
    half = np.array(unit) / 2 - corner
    return _placed(signs * half + corner * np.stack([np.cos(bow), np.sin(bow)], 1), position, angle)


def pieces(
    position: Points, parted: Bool[np.ndarray, " link"], ends: Float[np.ndarray, "link 2"]
) -> list[Points]:
    """The chain as lines (m), one for each piece: where a link is cut it hangs on the unit before
    it, up to its second end."""
    cut = np.flatnonzero(parted)
    hanging = [*(ends[link][None] for link in cut), ends[:0]]
    return [np.concatenate(p) for p in zip(np.split(position, cut + 1), hanging, strict=True)]


def lines(swim: Trajectory, now: float | int) -> list[Points]:
    """The chain as lines (m) at a time (control steps): through the units, or hinge to hinge."""
    if swim.is_rigid:
        return [between(swim.hinges, now)]
    units, ends = between(swim.unit_position, now), between(swim.link_ends, now)
    return pieces(units, swim.parted[int(now)], ends)


def between(values: np.ndarray, now: float | int) -> Any:
    """The values at a time between two steps."""
    first = min(int(now), len(values) - 1)
    last, part = min(first + 1, len(values) - 1), now - first
    return (1 - part) * values[first] + part * values[last]


def crosses(
    position: Points, angle: Float[np.ndarray, " unit"], unit: Size = UNIT
) -> Float[np.ndarray, "line 2 2"]:
    """Two lines (m) across each unit: the mark of a dead thruster."""
    reach = 0.55 * (np.array(unit) / 2)
    arms = np.array([[[-1, -1], [1, 1]], [[-1, 1], [1, -1]]]) * reach
    return _placed(np.tile(arms.reshape(4, 2), (len(angle), 1, 1)), position, angle).reshape(
        -1, 2, 2
    )


def jet_outlines(
    position: Points,
    angle: Float[np.ndarray, " unit"],
    thrust: Float[np.ndarray, " unit"],
    width: float = 1.0,
    unit: Size = UNIT,
    scale: float = 1.0,
) -> Outlines:
    """Drops (m) that leave each unit opposite to its push; none where the thrust is zero.

    A positive thrust pushes along the heading, so its water leaves at the other side. Lengths are
    those of `jet_size`, times `scale`.
    """
    size = jet_size(thrust)
    away = np.linspace(0, 1, 2 * DETAIL)
    reach, girth = JET * scale, 0.014 * scale * width * np.sqrt(1 - away) * (0.55 + 1.2 * away)
    right, left = np.stack([girth, -away], 1), np.stack([-girth, -away], 1)[::-1]
    drop = (
        np.concatenate([right, left])[None]
        * np.stack([(0.35 + 0.65 * size) * (size > 0), reach * size * np.sign(thrust)], 1)[:, None]
    )
    rim = np.array([0.0, 1.0]) * (-np.sign(thrust) * (unit[1] / 2 - 0.003 * scale))[:, None]
    return _placed(drop + rim[:, None], position, angle)


def jet_size(thrust: Float[np.ndarray, " unit"]) -> Float[np.ndarray, " unit"]:
    """Length of each jet as a fraction of that of 1 N: the square root of the thrust (N).

    Near the target thrusts are small and count the most; on a linear scale they would not be
    seen. Zero stays zero. The pages draw jets by the same rule.
    """
    strength = np.abs(thrust)
    return np.where(strength < FAINTEST, 0.0, np.maximum(np.sqrt(strength), SHORTEST_JET))


def _placed(shape: np.ndarray, position: Points, angle: Float[np.ndarray, " unit"]) -> Outlines:
    """Shapes around the origin turned and moved to each unit."""
    cos, sin = np.cos(angle)[:, None], np.sin(angle)[:, None]
    x, y = shape[..., 0], shape[..., 1]
    return position[:, None] + np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)


def round_length(length: float) -> float:
    """The largest of 1, 2 or 5 times a power of ten that is not longer."""
    power = 10.0 ** np.floor(np.log10(length))
    return float(power * max(k for k in (1, 2, 5) if k * power <= length * (1 + 1e-9)))


def length_name(length: float) -> str:
    """A round length with its unit."""
    return f"{length:g} m" if length >= 1 else f"{100 * length:g} cm"
