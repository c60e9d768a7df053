"""What units see of a passage: walls near by, and where its opening is."""

from dataclasses import replace

from salpchain.tasks.features import (
    COMPRESSED,
    OBSERVATIONS,
    RAYS,
    SURFACE,
    Observation,
    times,
    vector_feature,
)

# The opening of a passage of one wall is at the origin, and the wall is the y axis.
_OPENING = vector_feature(
    "opening minus own position", COMPRESSED, lambda view: times(view.position, -1.0)
)
_FAR_OPENING = replace(
    _OPENING, rows=lambda view: [view.compress(row) for row in _OPENING.rows(view)]
)
_THROUGH = vector_feature(
    "way through the wall", "1", lambda view: (view.angle * 0 + 1, view.angle * 0)
)

WALLS: Observation = (*OBSERVATIONS["proximity"], SURFACE, RAYS, _FAR_OPENING, _THROUGH)
