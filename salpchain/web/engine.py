"""The loop that makes a live world swim, and what it tells the browsers."""

import asyncio
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from salpchain.controllers.policy import Controller
from salpchain.errors import InputError
from salpchain.evaluation.suites import GRADES
from salpchain.evaluation.surroundings import Surroundings
from salpchain.physics.state import Physics
from salpchain.report.recorded import Recording
from salpchain.web import apart, messages
from salpchain.web.fleet import SPARE, Fleet
from salpchain.web.pool import SLOTS, Pool, slots_for
from salpchain.web.recorder import LONGEST, MOST_PARTS, Recordings
from salpchain.web.swimmer import LINK, Swimmer
from salpchain.web.troubles import TROUBLES, check_troubles
from salpchain.web.walls import NARROWEST, THICK
from salpchain.web.world import World
from salpchain.world.config import WorldConfig
from salpchain.world.presets import label
from salpchain.world.world import World as TankWorld

STEP = 0.1  # s of swimming in a control step
IDLE = 0.5  # s between looks while nobody watches (chosen)
LATEST = 0.25  # s that the loop may be late before it gives up catching up (chosen)


class Engine:
    """One world, one loop. Edits are carried out between two steps, at once.

    Everything runs in the event loop but reading policies and compiling, so nothing needs a lock.
    """

    def __init__(
        self,
        fleet: Fleet,
        tell: Callable[[bytes], None],
        complain: Callable[[str], None],
        seed: int = 0,
        config: WorldConfig | None = None,
    ) -> None:
        """`tell` gets every new state, as bytes for all browsers, and `complain` every error.

        `config` says which world is drawn at each reset; the still one if left out.
        """
        self.world, self.fleet = World(seed, config=config or WorldConfig()), fleet
        self._tell, self._complain = tell, complain
        self.pool, self.recordings = Pool(), Recordings(STEP, label(self.world.config))
        self.paused, self.speed, self.watched = False, 1.0, 0
        self.policy, self.loading = fleet.first, fleet.first
        self.roughening = False  # the program of rough water, or of walls, is being compiled
        self.took = 0.0  # s, of the last step
        self._controller: Controller | None = None
        self._tasks: set[asyncio.Task] = set()

    async def run(self) -> None:
        """Swims until cancelled."""
        self._start(self._first_policy())
        due = time.monotonic()
        while True:
            if self.paused or not self.watched or self._controller is None:
                await asyncio.sleep(IDLE if not self.watched else STEP / 4)
                due = time.monotonic()
                continue
            self.advance()
            due += STEP / self.speed
            late = time.monotonic() - due
            due = time.monotonic() if late > LATEST else due
            await asyncio.sleep(max(-late, 0.0))

    def advance(self) -> None:
        """One control step, told to everybody."""
        if self._controller is None:
            raise InputError("the policy is being loaded: wait a moment")
        begin, before = time.perf_counter(), (self.world.swimmers, self.world.tank.around)
        self.world.advance(self.pool, self._controller)
        self.took = time.perf_counter() - begin
        self._keep(before)
        self.show()

    def _keep(self, before: tuple[list[Swimmer], Surroundings]) -> None:
        """Records the control step just made, if a recording runs."""
        recorder = self.recordings.running
        if not recorder:
            return
        chains, around = before
        recorder.keep(chains, self.world.swimmers, self.world.current, self.policy, around)
        if recorder.full:
            most = f"{LONGEST * STEP / 60:.0f} minutes, {MOST_PARTS} edits"
            self._complain(f"a recording holds at most {most}: this one has ended")
            self.record(False)

    def show(self) -> None:
        """Tells everybody how the world is now."""
        self._tell(self.state())

    def do(self, message: messages.Message) -> None:
        """Carries out what a browser asked for.

        Raises:
            InputError: it cannot be done; nothing has changed.
        """
        HANDLERS[type(message)](self, message)
        self.show()

    def state(self) -> bytes:
        """The whole world as a message."""
        world, recorder = self.world, self.recordings.running
        return messages.write(
            "state",
            time=round(world.time * STEP, 1),
            epoch=world.epoch,
            paused=self.paused,
            speed=self.speed,
            policy=self.policy,
            loading=self.loading,
            took=round(1e3 * self.took, 2),
            current=_short(world.current),
            troubles=sorted(world.tank.troubles),
            grade=world.tank.grade,
            roughening=self.roughening,
            around=world.tank.told,
            recording=round(recorder.steps * STEP, 1) if recorder else None,
            recorded=self.recordings.newest,
            chains=[_chain(one) for one in world.swimmers],
        )

    def welcome(self) -> bytes:
        """What a browser must know once."""
        return messages.write(
            "welcome",
            policies=self.fleet.names,
            step=STEP,
            most=SLOTS[-1],
            wall={"width": THICK, "opening": NARROWEST},
            world=label(self.world.config),
            troubles=TROUBLES,
            grades=GRADES,
            unit=[Physics.unit_length, Physics.unit_width],
            link=LINK,
        )

    def pause(self, on: bool) -> None:
        """Stops or goes on."""
        self.paused = on

    def pace(self, speed: float) -> None:
        """Sets how fast time passes."""
        self.speed = speed

    def record(self, on: bool) -> None:
        """Starts a recording, or stops it and makes its page in the background."""
        if on:
            self.recordings.start()
        else:
            recording = self.recordings.stop()
            self._start(self._write(recording))

    async def _write(self, recording: Recording) -> None:
        await asyncio.to_thread(self.recordings.add, recording)
        self.show()

    def step(self) -> None:
        """Pauses, and makes one control step."""
        self.paused = True
        self.advance()

    def steer(self, name: str) -> None:
        """Lets another policy steer, as soon as it is read and compiled."""
        if name not in self.fleet.names:
            raise InputError("there is no such policy: choose one of the list")
        self._check_idle()
        self.loading = name
        self._start(self._change_policy(name))

    def _check_idle(self) -> None:
        """Raise InputError while a program is compiled for another controller or other water."""
        if self.loading:
            raise InputError(f"{self.loading} is being loaded: wait a moment")
        if self.roughening:
            raise InputError("other water is being made: wait a moment")

    def trouble(self, names: list[str], grade: str) -> None:
        """Puts the chains in troubles, as soon as the program for them is compiled."""
        meant = check_troubles(names, grade)
        self._check_idle()
        if self._controller is None:
            raise InputError("the policy is being loaded: wait a moment")
        one = self.world.swimmers[0]
        ready, pour = self.world.tank.is_rough, partial(self.world.pour, meant, grade)
        self._change_water(ready, partial(self.world.tank.rough_world, one), pour)

    def build(self, edit: Callable[[], None]) -> None:
        """Stands a wall or takes some away, as soon as the program for walls is compiled."""
        self._check_idle()
        tank = self.world.tank
        self._change_water(tank.is_walled, tank.walled_world, edit)

    def _change_water(
        self, ready: bool, make: Callable[[], TankWorld], edit: Callable[[], None]
    ) -> None:
        """Carries out an edit of the water, at once if the program for such a world is ready."""
        if self._controller is None:
            raise InputError("the policy is being loaded: wait a moment")
        if ready:
            edit()
            return
        self.roughening = True
        self._start(self._roughen(make, edit, self._controller))

    async def _roughen(
        self, make: Callable[[], TankWorld], edit: Callable[[], None], controller: Controller
    ) -> None:
        """The first troubles or walls: from then on, what swims is another program."""
        try:
            now = slots_for(self.world.num_units)
            other = await asyncio.to_thread(make)
            await asyncio.to_thread(self._prepare, controller, now, other)
            edit()
        except InputError as error:
            self._complain(str(error))
            return
        finally:
            self.roughening = False
            self.show()
        for slots in SLOTS:
            await asyncio.to_thread(self._prepare, controller, slots, other)

    def _prepare(self, controller: Controller, slots: int, world: TankWorld) -> None:
        """Compiles what a controller needs: of a planner, also the policy below it."""
        self.pool.prepare(apart.below(controller), slots, world)
        if apart.is_planner(controller) and world.obstacles is not None:
            self.pool.prepare(controller, slots, world)

    def _start(self, work: Any) -> None:
        """Runs in the background; kept, as the event loop keeps no task alive."""
        task = asyncio.ensure_future(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _first_policy(self) -> None:
        await self._change_policy(self.fleet.first)
        if self._controller is None and self.fleet.first != SPARE:
            await self._change_policy(SPARE)

    async def _change_policy(self, name: str) -> None:
        drawn = self.world.tank.world  # a later one differs in numbers alone
        try:
            controller = await asyncio.to_thread(self.fleet.load, name)
            self.world.steer_by(controller.card)
            await asyncio.to_thread(self._prepare, controller, SLOTS[0], drawn)
            self.world.steer_by(controller.card)  # chains may have changed meanwhile
            self._controller, self.policy = controller, name
        except (InputError, OSError) as error:
            self._complain(str(error))
        finally:
            self.loading = ""
        self.show()
        if self._controller is not None:
            await asyncio.to_thread(self._prepare, self._controller, SLOTS[1], drawn)


def _chain(one: Any) -> dict[str, Any]:
    """A chain in short numbers: 0.1 mm, a thousandth of a radian, a hundredth of a newton."""
    units = [
        [round(x, 4), round(y, 4), round(angle, 3), round(thrust, 2), int(works), int(cut)]
        for (x, y, angle), thrust, works, cut in zip(
            one.units[:, :3].tolist(),
            one.pushes.tolist(),
            one.works.tolist(),
            one.cuts.tolist(),
            strict=True,
        )
    ]
    return {
        "name": one.name,
        "units": units,
        "target": [_short(point) for point in one.target],
        "turn": round(one.turn, 4),
        "distance": round(one.distance, 4),
        "reached": one.reached,
        "arrived": None if one.arrived is None else round(one.arrived * STEP, 1),
        "since": round(one.since * STEP, 1),
        "speed": round(float(np.hypot(*one.units[:, 3:5].mean(axis=0))), 4),
    }


def _short(point: np.ndarray) -> list[float]:
    return [round(value, 4) for value in point.tolist()]


HANDLERS: dict[type, Callable[[Engine, Any], None]] = {
    messages.Place: lambda e, m: e.world.place(m.chain, m.x, m.y, m.turn),
    messages.Draw: lambda e, m: e.world.draw(m.chain, m.points),
    messages.Target: lambda e, m: e.world.retarget(m.chain),
    messages.Grow: lambda e, m: e.world.grow(m.chain),
    messages.Shrink: lambda e, m: e.world.shrink(m.chain),
    messages.Thruster: lambda e, m: e.world.switch(m.chain, m.unit, m.on),
    messages.Cut: lambda e, m: e.world.cut(m.chain, m.link),
    messages.Join: lambda e, m: e.world.join(m.chain, m.other),
    messages.Push: lambda e, m: e.world.push(m.chain, m.unit, m.x, m.y),
    messages.Flow: lambda e, m: e.world.flow(m.x, m.y),
    messages.Wall: lambda e, m: e.build(partial(e.world.build, m.begin, m.end, m.opening)),
    messages.Clear: lambda e, m: e.build(partial(e.world.clear, m.point)),
    messages.Trouble: lambda e, m: e.trouble(m.names, m.grade),
    messages.Steer: lambda e, m: e.steer(m.policy),
    messages.Pause: lambda e, m: e.pause(m.on),
    messages.Step: lambda e, m: e.step(),
    messages.Pace: lambda e, m: e.pace(m.speed),
    messages.Record: lambda e, m: e.record(m.on),
    messages.Reset: lambda e, m: e.world.reset(m.length),
}
