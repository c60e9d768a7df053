"""Recordings of the live world: what swims is kept step by step, within bounds."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from salpchain.errors import InputError
from salpchain.evaluation.surroundings import Surroundings
from salpchain.report.recorded import Part, Recording, recording_page
from salpchain.web.swimmer import ANGLE, Swimmer

LONGEST = 3000  # control steps of a recording: 5 minutes, 13 MB at most (chosen)
MOST_PARTS = 400  # of a recording (chosen; each takes a kilobyte of the page)
WATER = 10  # control steps at least between two pictures of water that changes (chosen)
KEPT = 3  # pages that can be fetched, 6 MB each at most; older ones are dropped (chosen)


@dataclass
class _Open:
    """A part that is being recorded; its last state is the very array that the chain has."""

    chain: int
    policy: str
    begin: int
    works: np.ndarray
    last: np.ndarray
    states: list[np.ndarray] = field(default_factory=list)  # (unit, 3) x, y, angle
    thrusts: list[np.ndarray] = field(default_factory=list)
    distances: list[float] = field(default_factory=list)
    reached: list[bool] = field(default_factory=list)
    parted: list[np.ndarray] = field(default_factory=list)  # (link,) whether cut
    targets: list[tuple[int, np.ndarray]] = field(default_factory=list)

    def goes_on(self, one: Swimmer, policy: str) -> bool:
        """Whether the chain is as the last step left it, but perhaps for its target."""
        same = self.last is one.units and self.policy == policy
        return same and bool((self.works == one.works).all())

    def aim(self, one: Swimmer) -> None:
        """Keeps the target if it was moved."""
        if not self.targets or self.targets[-1][1] is not one.target:
            self.targets.append((len(self.thrusts), one.target))

    def add(self, one: Swimmer) -> None:
        """Keeps how the chain is now."""
        self.last = one.units
        self.states.append(one.units[:, : ANGLE + 1].astype(np.float32))
        self.distances.append(one.distance)
        self.reached.append(one.reached)
        self.parted.append(one.cuts[:-1])

    def closed(self) -> Part:
        """The part as it is."""
        states = np.stack(self.states)
        return Part(
            self.chain,
            self.policy,
            self.begin,
            self.works,
            states[..., :ANGLE],
            states[..., ANGLE],
            np.stack(self.thrusts),
            np.array(self.distances),
            np.array(self.reached),
            self.targets,
            np.stack(self.parted),
        )


class Recorder:
    """Keeps the control steps of a world; edits between two steps show in the next one."""

    def __init__(self, dt: float, world: str = "still") -> None:
        """Nothing is recorded yet; a control step takes `dt` seconds."""
        self.steps, self._dt, self._world = 0, dt, world
        self._chains: dict[int, int] = {}  # number in the recording by name in the world
        self._open: dict[int, _Open] = {}
        self._closed: list[Part] = []
        self._current: list[tuple[int, float, float]] = []
        self._around: list[tuple[int, Surroundings]] = []

    @property
    def full(self) -> bool:
        """Whether it holds as much as it may."""
        parts = len(self._closed) + len(self._open)
        return self.steps >= LONGEST or parts >= MOST_PARTS

    def keep(
        self,
        before: Sequence[Swimmer],
        after: Sequence[Swimmer],
        current: np.ndarray,
        policy: str,
        around: Surroundings | None = None,
    ) -> None:
        """Keeps a control step: the chains as they were, edits included, and as they are now."""
        self._look(around or Surroundings())
        x, y = (round(float(value), 4) for value in current)
        if not self._current or self._current[-1][1:] != (x, y):
            self._current.append((self.steps, x, y))
        moved = {one.name: one for one in after}
        going = {one.name: self._part(one, policy) for one in before if one.name in moved}
        for name in set(self._open) - set(going):
            self._close(name)
        for name, part in going.items():
            part.thrusts.append(moved[name].pushes.astype(np.float32))
            part.add(moved[name])
        self._open = going
        self.steps += 1

    def _look(self, around: Surroundings) -> None:
        """Keeps what is around the chains if it has changed; of water alone not every change."""
        if self._around:
            step, last = self._around[-1]
            stands = [(last.walls, around.walls), (last.posts, around.posts)]
            same = all(np.array_equal(one, other) for one, other in stands)
            if around is last or (same and self.steps - step < WATER):
                return
        self._around.append((self.steps, around))

    def _part(self, one: Swimmer, policy: str) -> _Open:
        """The part that a chain is in, begun here if an edit has made another chain of it."""
        part = self._open.get(one.name)
        if part is None or not part.goes_on(one, policy):
            if part is not None:
                self._close(one.name)
            number = self._chains.setdefault(one.name, len(self._chains))
            part = _Open(number, policy, self.steps, one.works, one.units)
            part.add(one)
        part.aim(one)
        return part

    def _close(self, name: int) -> None:
        self._closed.append(self._open.pop(name).closed())

    def recording(self) -> Recording:
        """What was recorded.

        Raises:
            InputError: no step was.
        """
        if not self.steps:
            raise InputError("nothing was recorded: the chains did not swim meanwhile")
        parts = [*self._closed, *(part.closed() for part in self._open.values())]
        parts.sort(key=lambda part: (part.begin, part.chain))
        return Recording(parts, self._current, self._dt, self._around, self._world)


class Recordings:
    """At most one recording that runs, and the pages of the last ones."""

    def __init__(self, dt: float, world: str = "still") -> None:
        """None yet; `world` is what the world is called."""
        self._dt, self._world = dt, world
        self.running: Recorder | None = None
        self.newest = 0  # number of the newest page; 0 if there is none
        self.writing = False
        self._pages: dict[int, bytes] = {}

    def start(self) -> None:
        """Begins a recording.

        Raises:
            InputError: one runs, or is being written.
        """
        if self.running:
            raise InputError("a recording runs already: stop it first")
        if self.writing:
            raise InputError("the last recording is being written: wait a moment")
        self.running = Recorder(self._dt, self._world)

    def stop(self) -> Recording:
        """Ends the recording that runs and gives it; its page is to be added.

        Raises:
            InputError: none runs, or nothing was recorded.
        """
        if not self.running:
            raise InputError("nothing is being recorded: start a recording first")
        recorder, self.running = self.running, None
        recording = recorder.recording()
        self.writing = True
        return recording

    def add(self, recording: Recording, run: Callable[[Recording], str] = recording_page) -> None:
        """Writes the page of a recording that was stopped; may be called in a thread."""
        try:
            page = run(recording).encode()
            self._pages[self.newest + 1] = page
            self._pages.pop(self.newest + 1 - KEPT, None)
            self.newest += 1
        finally:
            self.writing = False

    def page(self, number: int) -> bytes | None:
        """The page of a recording, if it is there (still)."""
        return self._pages.get(number)
