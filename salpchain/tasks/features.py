"""What each number of an observation is: name, unit, frame; for those who build it themselves.

`tasks/observations.py` computes the numbers, in this order.
"""

from dataclasses import asdict, dataclass, replace

CONTROL_STEP = 0.1  # s
UNIT_AXES = "unit"  # along the unit, then along its heading (90 degrees anticlockwise from it)
WORLD = "world"


@dataclass(frozen=True)
class Field:
    """One number that a unit observes."""

    name: str
    unit: str  # of the number as given, scale included
    frame: str  # unit, world, or none for what has no direction


def _vector(name: str, unit: str, frame: str) -> tuple[Field, Field]:
    first, second = ("along", "heading") if frame == UNIT_AXES else ("x", "y")
    return Field(f"{name} {first}", unit, frame), Field(f"{name} {second}", unit, frame)


def _vectors(frame: str, *named: tuple[str, str]) -> tuple[Field, ...]:
    return tuple(field for name, unit in named for field in _vector(name, unit, frame))


COMPRESSED = "sign(x) log(1 + 5 |x|) of metres"
PROXIMITY = "2 (1 - distance / 0.2 m), 0 from 0.2 m on"
SPREAD = "of the root mean square distance of units to their centroid + 0.01 m"

LAYOUTS: dict[str, tuple[Field, ...]] = {
    "body": (
        *_vectors(
            UNIT_AXES,
            ("velocity", "0.2 m/s"),
            ("previous unit minus own position", "0.07 m, 0 without one"),
            ("next unit minus own position", "0.07 m, 0 without one"),
            ("previous target point minus own target point", "0.07 m, 0 without one"),
            ("next target point minus own target point", "0.07 m, 0 without one"),
            ("direction to own target point", "1 (distance / (distance + 0.01 m))"),
            ("mean velocity of the chain", "0.2 m/s"),
            ("own position minus centroid", SPREAD),
            ("own target point minus own position", COMPRESSED),
            ("centroid of the target minus centroid", COMPRESSED),
        ),
        Field("angular velocity", "3 rad/s", "none"),
        Field("place in the chain", "1, from -1 (first) to 1 (last)", "none"),
    ),
    "table1": (
        *(Field(f"bit {bit} of the unit's index", "1", "none") for bit in range(4)),
        *_vectors(WORLD, ("position", "m"), ("velocity", "m/s")),
        Field("angle", "rad, in [-pi, pi)", WORLD),
        Field("angular velocity", "rad/s", "none"),
        *_vectors(
            WORLD,
            ("velocity minus mean velocity", "m/s"),
            ("position minus centroid", "m"),
            ("position minus centroid of the target", "m"),
            ("own target point minus position", "m"),
        ),
        Field("bearing of the previous unit", "rad, 0 without one", UNIT_AXES),
        Field("bearing of the next unit", "rad, 0 without one", UNIT_AXES),
        *_vectors(
            WORLD,
            ("last force of the previous unit", "N, 0 without one"),
            ("last force of the next unit", "N, 0 without one"),
        ),
    ),
}

LAYOUTS["proximity"] = (
    *LAYOUTS["body"],
    *_vector("direction to the nearest unit that is no neighbour", PROXIMITY, UNIT_AXES),
)
LAYOUTS["anonymous"] = LAYOUTS["proximity"][:-3] + LAYOUTS["proximity"][-2:]
LAYOUTS["metric"] = tuple(
    replace(field, unit="m") if field.unit == COMPRESSED else field
    for field in LAYOUTS["proximity"]
)

ACTIONS = {
    "thrust": "one number for each unit, in [-1, 1]: its thrust (N) along its heading",
    "pair": "two numbers for each unit, in [-1, 1]: thrust (N) = (first - second) / 2",
}


def as_rows(observation: str) -> list[dict[str, str]]:
    """The layout of an observation as plain values for JSON."""
    return [asdict(field) for field in LAYOUTS[observation]]
