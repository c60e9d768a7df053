"""What browser and server say to each other: JSON, checked against these types."""

from typing import Annotated, Any

import msgspec
from msgspec import Meta, Struct

LONGEST_DRAWING = 500  # points (chosen)
FARTHEST = 1000.0  # m from the origin (chosen)

Metres = Annotated[float, Meta(ge=-FARTHEST, le=FARTHEST)]
Radians = Annotated[float, Meta(ge=-1e4, le=1e4)]
Count = Annotated[int, Meta(ge=0, le=10**9)]
Point = tuple[Metres, Metres]


class Message(Struct, tag_field="type", tag=str.lower, forbid_unknown_fields=True, kw_only=True):
    """What a browser says; `type` is the class's name in small letters."""


class Place(Message):
    """Move a chain's target pose."""

    chain: Count
    x: Metres
    y: Metres
    turn: Radians


class Draw(Message):
    """Give a chain a target along a line."""

    chain: Count
    points: Annotated[list[Point], Meta(min_length=2, max_length=LONGEST_DRAWING)]


class Target(Message):
    """Give a chain a new random target near it."""

    chain: Count


class Grow(Message):
    """Add a unit at a chain's end."""

    chain: Count


class Shrink(Message):
    """Take a unit away."""

    chain: Count


class Thruster(Message):
    """Turn a unit's thruster on or off."""

    chain: Count
    unit: Count
    on: bool


class Cut(Message):
    """Cut the link after a unit."""

    chain: Count
    link: Count


class Join(Message):
    """Link two chains at their nearest ends."""

    chain: Count
    other: Count


class Push(Message):
    """Kick a unit (m/s)."""

    chain: Count
    unit: Count
    x: Annotated[float, Meta(ge=-10, le=10)]
    y: Annotated[float, Meta(ge=-10, le=10)]


class Flow(Message):
    """Set the current (m/s)."""

    x: Annotated[float, Meta(ge=-10, le=10)]
    y: Annotated[float, Meta(ge=-10, le=10)]


class Wall(Message):
    """Stand a wall between two points, with an opening in its middle (m) if any."""

    begin: Point
    end: Point
    opening: Annotated[float, Meta(ge=0, le=100)] = 0.0


class Clear(Message):
    """Take away the wall drawn nearest to a point, or all that were drawn."""

    point: Point | None = None


class Trouble(Message):
    """Put all chains in these troubles, and in no others."""

    names: Annotated[list[Annotated[str, Meta(max_length=40)]], Meta(max_length=40)]
    grade: Annotated[str, Meta(max_length=40)]


class Steer(Message):
    """Let a policy of the list steer."""

    policy: Annotated[str, Meta(max_length=200)]


class Pause(Message):
    """Stop or go on."""

    on: bool


class Step(Message):
    """One control step while paused."""


class Pace(Message):
    """Seconds of swimming in each second."""

    speed: Annotated[float, Meta(ge=0.05, le=4)]


class Reset(Message):
    """A new chain and a new target; as long as all chains together if no length is given."""

    length: Annotated[int, Meta(ge=2, le=1024)] | None = None


class Record(Message):
    """Start a recording, or stop it and make a replay page of it."""

    on: bool


Edit = (
    Place | Draw | Target | Grow | Shrink | Thruster | Cut | Join | Push | Flow | Wall | Clear
    | Trouble | Steer | Pause | Step | Pace | Reset | Record
)  # fmt: skip
_decoder = msgspec.json.Decoder(Edit)
_encoder = msgspec.json.Encoder()


def read(text: str | bytes) -> Message:
    """The message in a text.

    Raises:
        ValueError: no JSON, no such message, or a field that is missing, unknown or out of bounds;
            the text says which.
    """
    try:
        return _decoder.decode(text)
    except RecursionError:
        raise ValueError("JSON is nested too deeply") from None


def write(kind: str, **content: Any) -> bytes:
    """A message to browsers: `welcome`, `state`, `error` or `notice`."""
    return _encoder.encode({"type": kind, **content})


def schema() -> dict[str, Any]:
    """JSON Schema of what a browser may say."""
    return msgspec.json.schema(Edit)
