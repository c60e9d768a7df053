"""Pictures of a chain and its target as it swims, for tools that show an environment."""

import time
from typing import Any

import numpy as np
from jaxtyping import UInt8
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from salpchain.dynamics.robot import scale_of
from salpchain.report.picture import FAINT, INK, PLACES, WATER
from salpchain.report.shapes import unit_outlines
from salpchain.tasks.features import CONTROL_STEP
from salpchain.tasks.state import State

SIDE = 480  # pixels
MARGIN = 0.15  # m, around chain and target, of the paper's links
DOTS = 100  # for each inch

Frame = UInt8[np.ndarray, "row column 3"]


class Screen:
    """Draws one chain, frame by frame; what is seen only grows while an episode goes on."""

    def __init__(self) -> None:
        """A screen on which nothing was drawn."""
        self._low = self._high = np.zeros(2)
        self._window: Any = None
        self._shown = 0.0  # when, s

    def frame(self, state: State) -> Frame:
        """A square picture (SIDE x SIDE pixels, red, green, blue) of one unbatched state."""
        position, angle = (
            np.asarray(state.chain.units.position),
            np.asarray(state.chain.units.angle),
        )
        target = np.asarray(state.target)
        self._see(np.concatenate([position, target]), begun=int(state.time) == 0)
        figure = Figure(figsize=(SIDE / DOTS, SIDE / DOTS), dpi=DOTS, facecolor=WATER)
        canvas = FigureCanvasAgg(figure)
        panel = figure.add_axes((0, 0, 1, 1))
        panel.set_axis_off()
        physics = state.world.dynamics
        middle, half = (self._low + self._high) / 2, (self._high - self._low).max() / 2
        half += MARGIN * scale_of(physics)
        panel.set_xlim(middle[0] - half, middle[0] + half)
        panel.set_ylim(middle[1] - half, middle[1] + half)
        panel.plot(*target.T, ".-", color=FAINT, linewidth=1, markersize=5)
        panel.plot(*position.T, color=INK, linewidth=1)
        colours = np.asarray(PLACES(np.linspace(0, 1, len(position))))
        size = float(physics.unit_length), float(physics.unit_width)
        boxes = list(unit_outlines(position, angle, size))
        panel.add_collection(PolyCollection(boxes, facecolors=colours))
        panel.text(0.02, 0.97, _words(state), color=INK, transform=panel.transAxes, va="top")
        canvas.draw()
        return np.asarray(canvas.buffer_rgba())[..., :3].copy()

    def _see(self, points: np.ndarray, begun: bool) -> None:
        low, high = points.min(axis=0), points.max(axis=0)
        fresh = begun or not (self._high - self._low).any()
        self._low = low if fresh else np.minimum(low, self._low)
        self._high = high if fresh else np.maximum(high, self._high)

    def show(self, state: State) -> None:
        """Shows the frame in a window of Matplotlib (none where there is no display).

        Frames come no faster than the chain swims: one in 0.1 s.
        """
        from matplotlib import pyplot

        frame = self.frame(state)
        if self._window is None:
            figure = pyplot.figure(figsize=(SIDE / DOTS, SIDE / DOTS), dpi=DOTS)
            self._window = figure, figure.figimage(frame)
            figure.show(warn=False)
        figure, image = self._window
        image.set_data(frame)
        figure.canvas.draw_idle()
        if figure.canvas.required_interactive_framework is None:  # nobody watches
            figure.canvas.flush_events()
        else:
            due = self._shown + CONTROL_STEP - time.monotonic()
            figure.canvas.start_event_loop(max(due, 1e-3))
            self._shown = time.monotonic()

    def close(self) -> None:
        """Closes the window, if there is one."""
        if self._window is not None:
            from matplotlib import pyplot

            pyplot.close(self._window[0])
            self._window = None


def _words(state: State) -> str:
    step = float(state.world.dynamics.control_step)
    seconds, apart = step * int(state.time), float(state.distances.mean)
    return f"{state.target.shape[0]} units, {seconds:.1f} s, {apart:.2f} m from the target"
