"""What features are worked out from: a chain and its target as rows, whatever the engine."""

from collections.abc import Mapping
from typing import Any

Row = Any  # one number of every unit: an array of JAX or a tensor of PyTorch
Pair = tuple[Row, Row]  # x and y, or along the unit and along its heading


class View:
    """A chain and its target as rows, in world axes and SI units."""

    position: Pair  # m
    velocity: Pair  # m/s
    target: Pair  # m, own target point
    force: Pair  # N, of the last thrust, as it acted
    angle: Row  # rad
    angular_velocity: Row  # rad/s
    sensed: Mapping[str, Any]  # what the features' `senses` gave: rows of each

    @property
    def centroid(self) -> Pair:
        """Mean position of the chain's units (m)."""
        raise NotImplementedError

    @property
    def target_centroid(self) -> Pair:
        """Mean of the target points (m)."""
        raise NotImplementedError

    def mean(self, pair: Pair) -> Pair:
        """Mean over the present units."""
        raise NotImplementedError

    def own(self, pair: Pair) -> Pair:
        """World vectors in each unit's axes: along the unit, and along its heading."""
        raise NotImplementedError

    def neighbours(self, row: Row) -> tuple[Row, Row]:
        """What the previous and what the next linked unit has; zero where there is none."""
        raise NotImplementedError

    def towards(self, pair: Pair) -> tuple[Pair, Pair]:
        """From each unit's point to those of the previous and next linked unit; else zero."""
        raise NotImplementedError

    def nearest(self) -> Pair:
        """To the nearest unit that is no neighbour, 1 - distance / `SENSED` long."""
        raise NotImplementedError

    def bearing(self, vector: Pair) -> Row:
        """Angle of a vector from the unit's own angle (rad, wrapped); 0 of no vector."""
        raise NotImplementedError

    def bit(self, place: int) -> Row:
        """A bit of the unit's index in the chain."""
        raise NotImplementedError

    def place(self) -> Row:
        """Place in the chain, from -1 (first) to 1 (last)."""
        raise NotImplementedError

    def wrap(self, angle: Row) -> Row:
        """An angle (rad) in [-pi, pi)."""
        raise NotImplementedError

    def root(self, row: Row) -> Row:
        """The square root."""
        raise NotImplementedError

    def compress(self, row: Row) -> Row:
        """sign(x) log(1 + 5 |x|)."""
        raise NotImplementedError
