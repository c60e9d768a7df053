"""Fixed sets of worlds in which a controller is judged. Imports nothing heavy.

A suite says which cells there are: a trouble, a grade, a length, and the worlds that the trials of
the cell swim in. What a version of it holds never changes.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from math import radians
from typing import NamedTuple

from salpchain.checks import one_of
from salpchain.physics.sizes import LINK_LENGTH
from salpchain.ranges import Range
from salpchain.world.config import (
    CurrentConfig,
    DynamicsConfig,
    SensingConfig,
    ThrusterConfig,
    WorldConfig,
)

GRADES = ("easy", "medium", "hard")
STILL = "still"  # the trouble that is none, and whose grade is none
UNGRADED = "none"


class Cell(NamedTuple):
    """One trouble at one grade. The trials take its worlds in turn, by name.

    With `once`, what is drawn of a world is drawn once for all trials.
    """

    trouble: str
    grade: str
    worlds: Mapping[str, WorldConfig]
    once: bool = False


Worlds = Callable[[int, int], Mapping[str, WorldConfig]]  # of a grade (0 to 2) and a length


@dataclass(frozen=True)
class Suite:
    """Troubles, and the lengths and the number of trials that are meant for each of their cells."""

    name: str
    version: int
    lengths: tuple[int, ...]
    trials: int
    troubles: Mapping[str, Worlds]

    def cells(self, length: int) -> Iterator[Cell]:
        """All cells at a length, still water first."""
        yield Cell(STILL, UNGRADED, {STILL: WorldConfig()})
        for trouble, worlds in self.troubles.items():
            for grade, name in enumerate(GRADES):
                yield Cell(trouble, name, worlds(grade, length))


def _fixed(*numbers: float) -> list[Range]:
    return [Range(float(number), float(number)) for number in numbers]


STEPS = _fixed(1.0, 2.0, 3.0)  # control steps, of delays and of repeats
POSITIONS = _fixed(0.002, 0.005, 0.01)  # m, and m/s
ANGLES = _fixed(*map(radians, (1.0, 3.0, 6.0)))  # rad, and rad/s
FAULTS = _fixed(0.01, 0.05, 0.1)  # probability in each step that a reading is dropped; stuck
FAULT_STEPS = _fixed(1.0, 5.0, 10.0)
GAINS = (Range(0.8, 1.0), Range(0.6, 1.0), Range(0.4, 1.0))  # chosen round the middle one
SPEEDS = (0.02, 0.04, 0.08)  # m/s, of the water
LAGS = _fixed(0.0, 0.2, 0.4)  # s, of jets that push one way (chosen)
OFF = (0.1, 0.2, 0.4)  # by which masses, drag and stiffness are off


def _share(grade: int, length: int) -> float:
    """The fraction of the units that is dead: one unit, a quarter, half."""
    return (1 / length, 0.25, 0.5)[grade]


def _delay(grade: int, length: int) -> Mapping[str, WorldConfig]:
    late = SensingConfig(delay=STEPS[grade], action_delay=STEPS[grade])
    return {"delay": WorldConfig(sensing=late)}


def _noise(grade: int, length: int) -> Mapping[str, WorldConfig]:
    noisy = SensingConfig(position=POSITIONS[grade], angle=ANGLES[grade])
    return {"noise": WorldConfig(sensing=noisy)}


def _dropout(grade: int, length: int) -> Mapping[str, WorldConfig]:
    often, steps = FAULTS[grade], FAULT_STEPS[grade]
    dropped = SensingConfig(dropped=often, dropped_steps=steps)
    stuck = SensingConfig(stuck=often, stuck_steps=steps)
    return {"dropped": WorldConfig(sensing=dropped), "stuck": WorldConfig(sensing=stuck)}


def _repeat(grade: int, length: int) -> Mapping[str, WorldConfig]:
    return {"repeat": WorldConfig(sensing=SensingConfig(repeat=STEPS[grade]))}


def _dead(grade: int, length: int) -> Mapping[str, WorldConfig]:
    (share,) = _fixed(_share(grade, length))
    return {"dead": WorldConfig(thrusters=ThrusterConfig(dead=share))}


def _failing(grade: int, length: int) -> Mapping[str, WorldConfig]:
    (share,) = _fixed(_share(grade, length))
    return {"failing": WorldConfig(thrusters=ThrusterConfig(failing=share))}


def _weak(grade: int, length: int) -> Mapping[str, WorldConfig]:
    return {"weak": WorldConfig(thrusters=ThrusterConfig(gain=GAINS[grade]))}


def _currents(speed: float, length: int) -> dict[str, CurrentConfig]:
    """Shear: the speed is reached two lengths of the chain off its line. Changing: by a third."""
    at, growth, third = _fixed(speed, speed / (2 * length * LINK_LENGTH), speed / 3)
    return {
        "uniform": CurrentConfig(speed=at),
        "shear": CurrentConfig(shear=growth),
        "vortex": CurrentConfig(vortex=at),
        "changing": CurrentConfig(speed=at, wander=third),
    }


def _current(grade: int, length: int) -> Mapping[str, WorldConfig]:
    kinds = _currents(SPEEDS[grade], length)
    return {kind: WorldConfig(current=current) for kind, current in kinds.items()}


def _one_sided(grade: int, length: int) -> Mapping[str, WorldConfig]:
    jets = ThrusterConfig(one_sided=True, lag=LAGS[grade])
    return {"one-sided": WorldConfig(thrusters=jets)}


def _physics(grade: int, length: int) -> Mapping[str, WorldConfig]:
    about = Range(1 - OFF[grade], 1 + OFF[grade])
    return {"physics": WorldConfig(dynamics=DynamicsConfig(about, about, about))}


def _substeps(grade: int, length: int) -> Mapping[str, WorldConfig]:
    return {"substeps": WorldConfig(dynamics=DynamicsConfig(substeps=2 + grade))}


def _all(grade: int, length: int) -> Mapping[str, WorldConfig]:
    """Every trouble but finer substeps, which are none at sea; half of what dies fails on the way.

    With a whole share dead and as many failing, no thruster would be left at the hard grade.
    """
    often, steps, about = FAULTS[grade], FAULT_STEPS[grade], Range(1 - OFF[grade], 1 + OFF[grade])
    share = max(1, round(_share(grade, length) * length))
    dead, failing = _fixed(-(-share // 2) / length, share // 2 / length)
    sensing = SensingConfig(
        position=POSITIONS[grade],
        angle=ANGLES[grade],
        dropped=often,
        dropped_steps=steps,
        stuck=often,
        stuck_steps=steps,
        delay=STEPS[grade],
        action_delay=STEPS[grade],
        repeat=STEPS[grade],
    )
    thrusters = ThrusterConfig(dead, failing, GAINS[grade], LAGS[grade], one_sided=True)
    dynamics = DynamicsConfig(about, about, about)
    kinds = _currents(SPEEDS[grade], length)
    return {
        kind: WorldConfig("still", dynamics, current, thrusters, sensing)
        for kind, current in kinds.items()
    }


SUITES: Mapping[str, Suite] = {
    "sea": Suite(
        name="sea",
        version=1,
        lengths=(4, 8, 16, 32, 64),
        trials=200,
        troubles={
            "delay": _delay,
            "noise": _noise,
            "dropout": _dropout,
            "repeat": _repeat,
            "dead": _dead,
            "failing": _failing,
            "weak": _weak,
            "current": _current,
            "one-sided": _one_sided,
            "physics": _physics,
            "substeps": _substeps,
            "all": _all,
        },
    )
}


def suite(name: object) -> Suite:
    """The suite of this name.

    Raises:
        InputError: there is none; the message lists the names.
    """
    one_of("suite", name, SUITES)
    return SUITES[str(name)]
