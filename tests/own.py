"""What users write in modules of their own; tests name it as `tests.own:NAME`."""

from salpchain.tasks.features import OBSERVATIONS, minus, scalar_feature

SPEED = scalar_feature(
    "speed", "m/s", lambda view: view.root(view.velocity[0] ** 2 + view.velocity[1] ** 2)
)
FASTER = (*OBSERVATIONS["proximity"], SPEED)
NOT_FEATURES = ("speed", "place")
AHEAD = minus  # an object that is neither
