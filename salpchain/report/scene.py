"""One moment of a trajectory, drawn into a rectangle of a canvas."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from salpchain.evaluation.trajectory import Trajectory
from salpchain.report import surroundings
from salpchain.report.canvas import Canvas, shortened, text_width
from salpchain.report.shapes import (
    LINK_WIDTH,
    REACHED,
    between,
    crosses,
    jet_outlines,
    length_name,
    lines,
    place_colours,
    round_length,
    unit_outlines,
)

DEEP, SHALLOW = np.array([8, 29, 48]) / 255, np.array([17, 66, 92]) / 255  # of the water
INK, FAINT, GHOST = (0.95, 0.98, 1.0), (0.56, 0.72, 0.82), (0.47, 0.76, 0.92)
DONE = (0.55, 0.95, 0.68)
STONE, RIM = (0.20, 0.27, 0.33), (0.58, 0.67, 0.72)
STREAKS = 18  # along the longer side of a picture (chosen)
SHINE = 0.18  # how far the middle of a unit is lighter than its rim (chosen)
SPECK = 2.4  # pixels, of the smallest unit that is drawn as a box (chosen)
TRAIL = 60  # control steps of the centroid's way that glow strongest (chosen)


@dataclass(frozen=True)
class Box:
    """A rectangle of a canvas (pixels from its lower left corner)."""

    x: float
    y: float
    width: float
    height: float


@dataclass(frozen=True)
class Scene:
    """A trajectory and the rectangle in which it is shown, whole.

    With a title, its words, clock and scale bar are above and below the swim; with none, the swim
    alone fills the rectangle.
    """

    swim: Trajectory
    box: Box
    title: str

    @property
    def text_size(self) -> float:
        """Of the smaller words (pixels)."""
        return max(9.0, min(self.box.width / 42, self.box.height / 26))

    @cached_property
    def scale(self) -> float:
        """Pixels for a metre: everything that happens fits between the words."""
        low, high = self._reach
        words = 5.2 * self.text_size if self.title else 0.0
        room = np.array([self.box.width, self.box.height - words])
        return float((room / (high - low)).min())

    @cached_property
    def _own(self) -> float:
        """Pixels for what is a metre of a chain with the paper's links."""
        return self.scale * self.swim.scale

    @cached_property
    def _reach(self) -> Float[np.ndarray, "2 2"]:
        """Lowest and highest coordinates (m) that are shown."""
        points = np.concatenate([self.swim.unit_position, self.swim.targets]).reshape(-1, 2)
        points = np.concatenate([points, surroundings.near(self.swim.around, points)])
        points = points @ self._turn.T
        low, high = points.min(axis=0), points.max(axis=0)
        margin = 0.08 * self.swim.scale + 0.03 * (high - low).max()
        return np.stack([low - margin, high + margin])

    @cached_property
    def _turn(self) -> Float[np.ndarray, "2 2"]:
        """Turns the way to the target along the longer side of the rectangle."""
        x, y = self.swim.targets[0].mean(axis=0) - self.swim.centroid[0]
        bearing = np.arctan2(y, x) - (0.0 if self.box.width >= self.box.height else np.pi / 2)
        cos, sin = np.cos(bearing), np.sin(bearing)
        return np.array([[cos, sin], [-sin, cos]])

    def at(self, points: np.ndarray) -> np.ndarray:
        """Where points (m) are on the canvas (pixels)."""
        lowered = self.text_size if self.title else 0.0
        middle = np.array(
            [self.box.x + self.box.width / 2, self.box.y + self.box.height / 2 - lowered]
        )
        return (points @ self._turn.T - self._reach.mean(axis=0)) * self.scale + middle

    def draw_still(self, canvas: Canvas) -> None:
        """What is the same at every moment: the target's band, its points, words, scale bar."""
        canvas.window(self.box.x, self.box.y, self.box.width, self.box.height)
        if not self.swim.target_moves:
            self._draw_band(canvas, self.swim.target)
        self._draw_obstacles(canvas)
        if not self.title:
            return
        size, left = self.text_size, self.box.x + self.text_size
        top, room = self.box.y + self.box.height - 1.9 * size, self.box.width - 2 * size
        title = shortened(self.title, room, 1.25 * size, bold=True)
        canvas.text(left, top, title, 1.25 * size, INK, bold=True)
        canvas.text(self._columns["s"], self._words_at, "s", size, FAINT)
        canvas.text(self._columns["unit"], self._words_at, self._unit, size, FAINT)
        self.draw_scale_bar(canvas, size)

    def _draw_band(self, canvas: Canvas, target: np.ndarray) -> None:
        """The band around a target (m) within which it counts as taken."""
        canvas.lines([self.at(target)], GHOST, 2 * REACHED * self._own, alpha=0.13)

    def _draw_obstacles(self, canvas: Canvas) -> None:
        """Walls and posts: a soft shadow, the stone, its lit rim."""
        around, rim = self.swim.around, max(1.0, 0.005 * self.scale)
        shapes = surroundings.wall_outlines(around.walls), surroundings.post_outlines(around.posts)
        outlines = [one for every in shapes for one in self.at(every)]
        closed = [np.vstack([one, one[:1]]) for one in outlines]
        canvas.lines(closed, DEEP, 6 * rim, alpha=0.35)
        canvas.lines(closed, RIM, 2 * rim)  # of which the stone covers half, and where two meet
        canvas.fill(outlines, STONE)
        caps = surroundings.post_outlines(around.posts, 0.55)
        canvas.fill(self.at(caps), RIM, alpha=0.16)

    @cached_property
    def _sources(self) -> np.ndarray:
        """Where streaks of the water begin (m): all over the rectangle."""
        apart = max(self.box.width, self.box.height, 300.0) / STREAKS
        across, up = (
            np.arange(0.5, max(np.ceil(size / apart), 1)) * apart
            for size in (self.box.width, self.box.height)
        )
        pixels = np.stack(np.meshgrid(self.box.x + across, self.box.y + up), axis=-1)
        middle = self.at(np.zeros((1, 2)))
        return (pixels.reshape(-1, 2) - middle) / self.scale @ self._turn

    def _draw_water(self, canvas: Canvas, time: float) -> None:
        """Streaks that move with the water, brightest where each is now."""
        swim = self.swim
        if not surroundings.is_moving(swim.around):
            return
        ways = self.at(surroundings.streaks(swim.around, self._sources, time, swim.duration))
        width = max(1.0, min(self.box.width, self.box.height) / 330)
        for piece in range(surroundings.PIECES):
            alpha = 0.06 + 0.34 * (piece + 1) / surroundings.PIECES
            canvas.lines(ways[:, piece : piece + 2], GHOST, width, alpha=alpha)

    @cached_property
    def _unit(self) -> str:
        """What follows the distance: the shorter words where the longer ones have no room."""
        long, size = "cm to the target", self.text_size
        end = self._columns["unit"] + text_width(long, size) + size
        end += 0.8 * size + text_width("reached", size, bold=True)
        return long if end <= self.box.x + self.box.width else "cm"

    @cached_property
    def _columns(self) -> dict[str, float]:
        """Where clock and distance end and their units begin (pixels), for the widest numbers."""
        size, swim = self.text_size, self.swim
        widest = (f"{swim.duration:.1f}", f"{100 * swim.distance.max():.1f}")
        clock, apart = (text_width("0" * len(number), size) for number in widest)
        time = self.box.x + size + clock
        seconds = time + 0.3 * size
        distance = seconds + text_width("s", size) + size + apart
        return {"time": time, "s": seconds, "distance": distance, "unit": distance + 0.3 * size}

    def draw_scale_bar(self, canvas: Canvas, size: float) -> None:
        """A round length in the lower right corner, with its name in this size (pixels)."""
        bar = round_length(self.box.width / self.scale / 5)
        right, low = self.box.x + self.box.width - size, self.box.y + size
        ends = np.array([[right - bar * self.scale, low], [right, low]])
        ticks = ends[:, None] + np.array([[0, -0.25], [0, 0.25]]) * size
        canvas.lines([ends, *ticks], INK, max(1.2, size / 8), alpha=0.9)
        canvas.text(
            ends[0, 0] - 0.6 * size, low - 0.35 * size, length_name(bar), size, INK, right=True
        )

    def draw(self, canvas: Canvas, time: float) -> None:
        """The chain at a time (s), its jets, its way, and lines to its target points.

        After the end of the episode it stays as it was.
        """
        canvas.window(self.box.x, self.box.y, self.box.width, self.box.height)
        now = float(min(time / self.swim.dt, self.swim.steps))
        position = between(self.swim.unit_position, now)
        angle = between(self.swim.unit_angle, now)
        self._draw_water(canvas, min(time, self.swim.duration))
        self._draw_trail(canvas, now)
        target = between(self.swim.targets, now)
        if self.swim.target_moves:
            self._draw_band(canvas, target)
        self._draw_ghosts(canvas, target, position, angle)
        if now < self.swim.steps:
            self._draw_jets(canvas, position, angle, self.swim.thrust[int(now)])
        self._draw_chain(canvas, position, angle, now)
        self._draw_dead(canvas, position, angle, int(now))
        if self.title:
            self._draw_words(canvas, now)

    def _draw_trail(self, canvas: Canvas, now: float) -> None:
        """The centroid's way up to now, brightest where it was last."""
        past = self.swim.centroid[: int(now) + 1]
        ways = self.at(np.vstack([past, between(self.swim.centroid, now)]))
        width, stride = max(1.2, 0.012 * self._own), max(1, len(ways) // 200)
        canvas.lines([np.vstack([ways[:-1:stride], ways[-1:]])], INK, width, alpha=0.16)
        for part, alpha in ((TRAIL, 0.14), (TRAIL // 2, 0.18), (TRAIL // 4, 0.25)):
            canvas.lines([ways[-max(part, 2) :]], INK, width, alpha=alpha)

    def _draw_ghosts(
        self, canvas: Canvas, target: np.ndarray, position: np.ndarray, angle: np.ndarray
    ) -> None:
        outlines, target = (
            self.at(unit_outlines(target, angle, self.swim.unit_size)),
            self.at(target),
        )
        pairs = np.stack([self.at(position), target], axis=1)
        canvas.lines(pairs, GHOST, max(0.7, 0.004 * self._own), alpha=0.30)
        canvas.lines([target], GHOST, max(1.0, 0.3 * LINK_WIDTH * self._own), alpha=0.55)
        canvas.fill(outlines, GHOST, alpha=0.34)

    def _draw_jets(
        self, canvas: Canvas, position: np.ndarray, angle: np.ndarray, thrust: np.ndarray
    ) -> None:
        sizes = self.swim.unit_size, self.swim.scale
        for width, alpha in ((1.5, 0.22), (0.9, 0.40), (0.45, 0.8)):
            jets = jet_outlines(position, angle, thrust, width, *sizes)
            canvas.fill(self.at(jets), INK, alpha)

    def _draw_chain(
        self, canvas: Canvas, position: np.ndarray, angle: np.ndarray, now: float
    ) -> None:
        way, width = self.at(position), max(1.6, LINK_WIDTH * self._own)
        parts = [self.at(part) for part in lines(self.swim, now)]
        canvas.lines(parts, DEEP, 1.7 * width, alpha=0.55)
        canvas.lines(parts, (0.82, 0.90, 0.94), width)
        if self.swim.unit_size[0] * self.scale < SPECK:
            _draw_specks(canvas, way)
            return
        outlines = self.at(unit_outlines(position, angle, self.swim.unit_size))
        canvas.lines(
            np.concatenate([outlines, outlines[:, :1]], 1), DEEP, max(1.0, 0.3 * width), alpha=0.7
        )
        for outline, colour in zip(outlines, place_colours(len(outlines)), strict=True):
            canvas.fill(outline[None], colour)
        shine = outlines.mean(axis=1, keepdims=True)
        canvas.fill(shine + 0.5 * (outlines - shine), (1.0, 1.0, 1.0), alpha=SHINE)

    def _draw_dead(
        self, canvas: Canvas, position: np.ndarray, angle: np.ndarray, step: int
    ) -> None:
        """Units whose thruster is dead in this control step: grey, with a cross."""
        dead = self.swim.around.dead(step, self.swim.length)
        if not dead.any():
            return
        width = max(1.2, 0.006 * self._own)
        where = position[dead], angle[dead], self.swim.unit_size
        canvas.fill(self.at(unit_outlines(*where)), STONE, alpha=0.8)
        canvas.lines(self.at(crosses(*where)), INK, width, alpha=0.95)

    def _draw_words(self, canvas: Canvas, now: float) -> None:
        """The numbers of clock and distance; the goal in words once it is reached."""
        size, low, at = self.text_size, self._words_at, self._columns
        apart = 100 * float(between(self.swim.distance, now))
        arrived = self.swim.success and now >= self.swim.steps
        colour = DONE if arrived else INK
        canvas.text(at["time"], low, f"{now * self.swim.dt:.1f}", size, colour, right=True)
        canvas.text(at["distance"], low, f"{apart:.1f}", size, colour, right=True)
        after = at["unit"] + text_width(self._unit, size) + 0.8 * size
        right = self.box.x + self.box.width - size
        if arrived and after + text_width("reached", size, bold=True) <= right:
            canvas.text(after, low, "reached", size, DONE, bold=True)

    @property
    def _words_at(self) -> float:
        """Height of the line with clock and distance (pixels)."""
        return self.box.y + self.box.height - 3.5 * self.text_size


def _draw_specks(canvas: Canvas, way: np.ndarray) -> None:
    """A chain whose units are too small to be seen: each as a piece of a line in its colour."""
    middle = (way[1:] + way[:-1]) / 2
    ends = np.concatenate([way[:1], middle, way[-1:]])
    for start, end, colour in zip(ends[:-1], ends[1:], place_colours(len(way)), strict=True):
        canvas.lines([np.stack([start, end])], colour, SPECK)


def water(canvas: Canvas, boxes: list[Box], dither: bool = True) -> None:
    """Water in each rectangle, lighter above; dark between them.

    Dithering hides the steps between its shades; without it a picture takes far less space.
    """
    height, width = canvas.height, canvas.width
    pixels = np.empty((height, width, 4), np.uint8)
    pixels[:] = (*(255 * 0.5 * DEEP).astype(int), 255)
    for box in boxes:
        top, left = round(height - box.y - box.height), round(box.x)
        rows, columns = round(box.height), round(box.width)
        pixels[top : top + rows, left : left + columns, :3] = 255 * _water(rows, columns, dither)
    canvas.paste(pixels)


def _water(rows: int, columns: int, dither: bool) -> Float[np.ndarray, "row column 3"]:
    """A gradient with light from above, broken by a few slow waves."""
    y, x = np.mgrid[0:rows, 0:columns] / max(rows, 1)
    light = np.exp(-1.5 * y - 0.6 * (x - 0.3) ** 2)
    waves = np.sin(9 * x + 4 * np.sin(3 * y)) * np.sin(7 * y + 3 * np.sin(4 * x + 1))
    spread = 0.5 if dither else 0.0
    noise = np.random.default_rng(0).uniform(-spread, spread, (rows, columns)) / 255
    share = np.clip(light + 0.035 * waves, 0, 1)[..., None]
    return np.clip(DEEP + share * (SHALLOW - DEEP) + noise[..., None], 0, 1)
