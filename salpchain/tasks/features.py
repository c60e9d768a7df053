"""What a unit can observe: features, each some numbers with name, unit, frame and how to get them.

One table for all engines: a feature is worked out from a `View` of the chain in the operations that
arrays of JAX and tensors of PyTorch share (`tasks/observations.py` and `interop/torch_task.py`
have the two views). An observation is a tuple of features. Imports nothing heavy.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from salpchain.checks import one_of
from salpchain.errors import InputError
from salpchain.given import instance, told
from salpchain.plugins import check_known, find
from salpchain.tasks.view import Pair, Row, View

CONTROL_STEP = 0.1  # s
UNIT_AXES = "unit"  # along the unit, then along its heading (90 degrees anticlockwise from it)
WORLD = "world"
FRAMES = (UNIT_AXES, WORLD, "none")
NEIGHBOUR = 0.07  # m, the scale of what is told of neighbours (fixed: policies learned with it)
SENSED = 0.2  # m, from which on a unit that is no neighbour is not sensed (chosen)


@dataclass(frozen=True)
class Field:
    """One number that a unit observes."""

    name: str
    unit: str  # of the number as given, scale included
    frame: str  # unit, world, or none for what has no direction


@dataclass(frozen=True)
class Feature:
    """Some numbers that a unit observes.

    `rows` gives them of a `View`, a row each. `senses` names what must be sensed of the world for
    them (`tasks/observations.py` lists what can be): `view.sensed[name]` then holds its rows.

    Raises:
        InputError: fields, rows or senses of another kind.
    """

    fields: tuple[Field, ...]
    rows: Callable[[Any], Sequence[Row]]
    senses: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        _check_all("fields", self.fields, Field, "a tuple of Field")
        _check_rows("rows", self.rows)
        _check_all("senses", self.senses, str, "a tuple of names")


Observation = tuple[Feature, ...]


def _check_all(name: str, given: object, kind: type, right: str) -> None:
    if not isinstance(given, tuple) or not all(isinstance(one, kind) for one in given):
        raise InputError(f"{name} of a feature must be {right}, got {told(given)}")


def _check_rows(name: str, given: object) -> None:
    if not callable(given):
        right = "a function of a view, such as lambda view: view.velocity"
        raise InputError(f"{name} of a feature must be {right}, got {told(given)}")


def _check_texts(name: str, unit: str, frame: str, senses: str) -> None:
    for what, text in (("name", name), ("unit", unit), ("senses", senses)):
        instance(f"{what} of a feature", text, str, "a text")
    one_of("frame", frame, FRAMES)


def vector_feature(
    name: str, unit: str, rows: Callable[[View], Pair], frame: str = UNIT_AXES, senses: str = ""
) -> Feature:
    """A feature that is a vector: `rows` gives its x and y in world axes of a `View`.

    It is told in each unit's own axes unless the frame is `world`. `senses` is `water` or another
    that `Feature` takes, if it needs any.

    Raises:
        InputError: an unknown frame, or anything of another kind.
    """
    _check_texts(name, unit, frame, senses)
    _check_rows("rows", rows)
    first, second = ("along", "heading") if frame == UNIT_AXES else ("x", "y")
    fields = Field(f"{name} {first}", unit, frame), Field(f"{name} {second}", unit, frame)
    turned = rows if frame == WORLD else lambda view: view.own(rows(view))
    return Feature(fields, turned, (senses,) if senses else ())


def scalar_feature(
    name: str, unit: str, row: Callable[[View], Row], frame: str = "none", senses: str = ""
) -> Feature:
    """A feature that is one number of each unit, which `row` gives of a `View`.

    Raises:
        InputError: an unknown frame, or anything of another kind.
    """
    _check_texts(name, unit, frame, senses)
    _check_rows("row", row)
    return Feature(
        (Field(name, unit, frame),), lambda view: [row(view)], (senses,) if senses else ()
    )


def minus(one: Pair, other: Pair) -> Pair:
    """The difference of two vectors."""
    return one[0] - other[0], one[1] - other[1]


def times(pair: Pair, factor: Any) -> Pair:
    """A vector times a number."""
    return pair[0] * factor, pair[1] * factor


def squares(pair: Pair) -> Pair:
    """The squares of a vector's coordinates."""
    return pair[0] ** 2, pair[1] ** 2


def _error(view: View) -> Pair:
    return minus(view.target, view.position)


def _aim(view: View) -> Pair:
    error = _error(view)
    return times(error, 1 / (view.root(sum(squares(error))) + 0.01))


def _aside(view: View) -> Pair:
    """From the centroid, in units of the chain's own spread.

    In metres, the ends of a long chain see what none saw in training: controllers trained on 8
    units then miss the target from 40 units on.
    """
    aside = minus(view.position, view.centroid)
    spread = view.root(sum(view.mean(squares(aside))))
    return times(aside, 1 / (spread + 0.01))


def _neighbour(points: str, side: int) -> Callable[[View], Pair]:
    return lambda view: times(view.towards(getattr(view, points))[side], 1 / NEIGHBOUR)


def _far(name: str, rows: Callable[[View], Pair]) -> Feature:
    """A vector of any size, so that what is far stays in the range of what was seen near by."""
    feature = vector_feature(name, COMPRESSED, rows)
    return replace(feature, rows=lambda view: [view.compress(row) for row in view.own(rows(view))])


COMPRESSED = "sign(x) log(1 + 5 |x|) of metres"
PROXIMITY = "2 (1 - distance / 0.2 m), 0 from 0.2 m on"
SPREAD = "of the root mean square distance of units to their centroid + 0.01 m"
LINKS = "0.07 m, 0 without one"

_ERROR = "own target point minus own position", _error
_CENTRES = (
    "centroid of the target minus centroid",
    lambda view: minus(view.target_centroid, view.centroid),
)
_NEAR_BY = (
    vector_feature("velocity", "0.2 m/s", lambda view: times(view.velocity, 5.0)),
    vector_feature("previous unit minus own position", LINKS, _neighbour("position", 0)),
    vector_feature("next unit minus own position", LINKS, _neighbour("position", 1)),
    vector_feature("previous target point minus own target point", LINKS, _neighbour("target", 0)),
    vector_feature("next target point minus own target point", LINKS, _neighbour("target", 1)),
    vector_feature("direction to own target point", "1 (distance / (distance + 0.01 m))", _aim),
    vector_feature(
        "mean velocity of the chain", "0.2 m/s", lambda view: times(view.mean(view.velocity), 5.0)
    ),
    vector_feature("own position minus centroid", SPREAD, _aside),
)
_TURNING = scalar_feature("angular velocity", "3 rad/s", lambda view: view.angular_velocity / 3)
_PLACE = scalar_feature(
    "place in the chain", "1, from -1 (first) to 1 (last)", lambda view: view.place()
)
# What a proximity sensor tells; without, units pressed against each other cannot know it.
_PROXIMITY = vector_feature(
    "direction to the nearest unit that is no neighbour",
    PROXIMITY,
    lambda view: times(view.nearest(), 2.0),
)

# The unit's own view, of much the same size at any length and distance.
BODY: Observation = (*_NEAR_BY, _far(*_ERROR), _far(*_CENTRES), _TURNING, _PLACE)
METRIC: Observation = (
    *_NEAR_BY,
    *(vector_feature(name, "m", rows) for name, rows in (_ERROR, _CENTRES)),
    _TURNING,
    _PLACE,
    _PROXIMITY,
)

# The paper's Table 1, in its order.
TABLE1: Observation = (
    *(
        scalar_feature(f"bit {bit} of the unit's index", "1", lambda view, bit=bit: view.bit(bit))
        for bit in range(4)
    ),
    vector_feature("position", "m", lambda view: view.position, WORLD),
    vector_feature("velocity", "m/s", lambda view: view.velocity, WORLD),
    scalar_feature("angle", "rad, in [-pi, pi)", lambda view: view.wrap(view.angle), WORLD),
    scalar_feature("angular velocity", "rad/s", lambda view: view.angular_velocity),
    vector_feature(
        "velocity minus mean velocity",
        "m/s",
        lambda view: minus(view.velocity, view.mean(view.velocity)),
        WORLD,
    ),
    vector_feature(
        "position minus centroid", "m", lambda view: minus(view.position, view.centroid), WORLD
    ),
    vector_feature(
        "position minus centroid of the target",
        "m",
        lambda view: minus(view.position, view.target_centroid),
        WORLD,
    ),
    vector_feature("own target point minus position", "m", _error, WORLD),
    *(
        scalar_feature(
            f"bearing of the {which} unit",
            "rad, 0 without one",
            lambda view, side=side: view.bearing(view.towards(view.position)[side]),
            UNIT_AXES,
        )
        for side, which in enumerate(("previous", "next"))
    ),
    *(
        vector_feature(
            f"last force of the {which} unit",
            "N, 0 without one",
            lambda view, side=side: (
                view.neighbours(view.force[0])[side],
                view.neighbours(view.force[1])[side],
            ),
            WORLD,
        )
        for side, which in enumerate(("previous", "next"))
    ),
)

# What can be sensed of the world around, for observations of one's own.
WATER = vector_feature(
    "velocity against the water", "0.2 m/s", lambda view: times(view.sensed["water"], 5.0),
    senses="water",
)  # fmt: skip
SURFACE = vector_feature(
    "direction to the nearest surface", "1 - distance / 0.2 m, 0 from 0.2 m on",
    lambda view: view.sensed["surface"], senses="surface",
)  # fmt: skip
THRUSTER = scalar_feature(
    "gain of the own thruster", "1, 0 where dead", lambda view: view.sensed["thruster"][0],
    senses="thruster",
)  # fmt: skip
REVERSE = scalar_feature(
    "gain of the own thruster backwards", "1, 0 where it pushes one way or is dead",
    lambda view: view.sensed["reverse"][0], senses="reverse",
)  # fmt: skip
THRUST = scalar_feature(
    "own thrust in the last step, as it acted", "N", lambda view: view.own(view.force)[1]
)
RAYS = Feature(
    tuple(
        Field(f"clear way at {45 * ray} degrees", "0.5 m, 1 where nothing is", UNIT_AXES)
        for ray in range(8)
    ),
    lambda view: view.sensed["rays"],
    ("rays",),
)

OBSERVATIONS: dict[str, Observation] = {
    "body": BODY,
    "table1": TABLE1,
    "proximity": (*BODY, _PROXIMITY),
    "anonymous": (*BODY[:-1], _PROXIMITY),
    "metric": METRIC,
    "around": (*BODY, _PROXIMITY, WATER, SURFACE, THRUSTER),
    "jets": (*BODY, _PROXIMITY, THRUSTER, REVERSE, THRUST),
    "sea": (*BODY, _PROXIMITY, THRUSTER, REVERSE, THRUST, WATER),
}

# Where the gains of the own thruster, forwards and backwards, are in what begins as `jets` does
_SEEN = [field for feature in OBSERVATIONS["jets"] for field in feature.fields]
JETS = _SEEN.index(THRUSTER.fields[0]), _SEEN.index(REVERSE.fields[0])

ACTIONS = {
    "thrust": "one number for each unit, in [-1, 1]: its thrust (N) along its heading",
    "pair": "two numbers for each unit, in [-1, 1]: thrust (N) = (first - second) / 2",
    "grip": "two numbers for each unit, in [-1, 1]: its thrust (N), and below -0.5 it lets go of"
    " the next unit, otherwise it holds it, and takes hold of it where it can",
}


LONGEST_HISTORY = 64  # readings that an observation may have (chosen)


def readings(observation: str) -> tuple[str, int]:
    """What is observed in each control step, and how many steps a unit sees at once.

    `jets*4` is `jets` now and in the three control steps before, the newest first.

    Raises:
        InputError: no such number.
    """
    name, star, number = observation.partition("*")
    if not star:
        return observation, 1
    if not number.isascii() or not number.isdigit() or not 2 <= int(number) <= LONGEST_HISTORY:
        raise InputError(
            f"observation {observation}: after * comes how many control steps are seen at once,"
            f" 2 to {LONGEST_HISTORY}, such as {name}*4"
        )
    return name, int(number)


def check_observation(name: object) -> None:
    """Raise InputError unless there is an observation of this name."""
    base = readings(name)[0] if isinstance(name, str) else name
    check_known("observation", base, OBSERVATIONS)
    if base not in OBSERVATIONS:
        features(str(name))


def features(observation: str) -> Observation:
    """The features of an observation: one of `OBSERVATIONS`, or `module:name` of one's own.

    Of one control step, where it is of several.

    Raises:
        InputError: there is none, or what there is is no sequence of features.
    """
    observation, _ = readings(observation)
    if observation in OBSERVATIONS:
        return OBSERVATIONS[observation]
    check_known("observation", observation, OBSERVATIONS)
    found: Any = find("observation", observation)
    several = isinstance(found, tuple | list)
    if not several or not found or not all(isinstance(one, Feature) for one in found):
        raise InputError(
            f"observation {observation} must be a tuple of features, such as"
            f" (*OBSERVATIONS['body'], scalar_feature(...)), got {told(found)}"
        )
    return tuple(found)


def layout(observation: str) -> tuple[Field, ...]:
    """What each number of an observation is, in their order."""
    now = tuple(field for feature in features(observation) for field in feature.fields)
    late = (
        replace(field, name=f"{field.name}, {_steps(steps)} before")
        for steps in range(1, readings(observation)[1])
        for field in now
    )
    return (*now, *late)


def _steps(number: int) -> str:
    return "1 control step" if number == 1 else f"{number} control steps"


def observation_size(observation: str) -> int:
    """Numbers that a unit observes."""
    return len(layout(observation))


def remembered_size(observation: str) -> int:
    """Numbers of a unit that are observed again in the next control step; 0 of a single step."""
    return observation_size(observation) if readings(observation)[1] > 1 else 0


def senses(observation: str) -> tuple[str, ...]:
    """What must be sensed of the world for an observation."""
    every = (sense for feature in features(observation) for sense in feature.senses)
    return tuple(dict.fromkeys(every))


def as_rows(observation: str) -> list[dict[str, str]]:
    """The layout of an observation as plain values for JSON."""
    return [asdict(field) for field in layout(observation)]
