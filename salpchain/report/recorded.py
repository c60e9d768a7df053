"""What was recorded of a live world, and the replay page that plays it."""

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from salpchain.evaluation.surroundings import Surroundings
from salpchain.report.replay import Scale, filled, packed_cuts, packed_motion, packed_surroundings


@dataclass(frozen=True, eq=False)
class Part:
    """A chain for as long as nothing but its target was changed by hand.

    A change of length, a cut, a join, a thruster switched or another policy ends a part and begins
    another. What a step has is entry k from time k to k + 1, as in a trajectory.
    """

    chain: int  # its number in the recording, from 0
    policy: str
    begin: int  # control steps from the start of the recording
    works: Bool[np.ndarray, " unit"]  # whether the unit's thruster is on
    position: Float[np.ndarray, "time unit 2"]  # m
    angle: Float[np.ndarray, "time unit"]  # rad
    thrust: Float[np.ndarray, "step unit"]  # N
    distance: Float[np.ndarray, " time"]  # m, mean, to the target of that time
    reached: Bool[np.ndarray, " time"]
    targets: Sequence[tuple[int, Float[np.ndarray, "unit 2"]]]  # m, from which step of the part on
    parted: Bool[np.ndarray, "time link"]  # links that a planner has cut

    @property
    def end(self) -> int:
        """Control steps from the start of the recording to the part's last moment."""
        return self.begin + len(self.thrust)


@dataclass(frozen=True, eq=False)
class Recording:
    """All chains of a world for some time."""

    parts: Sequence[Part]
    current: Sequence[tuple[int, float, float]]  # m/s, from which control step on
    dt: float  # s, of a control step
    around: Sequence[tuple[int, Surroundings]] = ()  # from which control step on
    world: str = "still"  # what it is called

    @property
    def steps(self) -> int:
        """Control steps."""
        return max(part.end for part in self.parts)


def recording_page(recording: Recording) -> str:
    """The replay page of a recording, as HTML that needs no network."""
    policies = list(dict.fromkeys(part.policy for part in recording.parts))
    changes = [part.begin for part in recording.parts] + [part.end for part in recording.parts]
    most = max(_num_at(recording, step) for step in changes)
    chains = "1 chain" if most == 1 else f"up to {most} chains"
    lasted = f"{recording.steps * recording.dt:.1f} s"
    where = "" if recording.world == "still" else f", world {recording.world}"
    world = {
        "title": "Recorded live",
        "about": f"{lasted}, {chains}, steered by {', '.join(policies)}{where}",
        "current": [list(entry) for entry in recording.current],
        "around": [[step, packed_surroundings(one, 0)] for step, one in recording.around],
    }
    parts = [packed_part(part, recording.dt) for part in recording.parts]
    return filled("Recorded live - salpchain replay", {"swims": parts, "world": world})


def _num_at(recording: Recording, step: int) -> int:
    """Chains that swim at once after a control step."""
    return sum(part.begin <= step < part.end for part in recording.parts)


def packed_part(part: Part, dt: float) -> dict[str, Any]:
    """A part as JSON, packed as trajectories are."""
    scale = Scale.of(part.position, *(target for _, target in part.targets))
    return {
        "chain": part.chain,
        "policy": part.policy,
        "begin": part.begin,
        "length": len(part.works),
        "steps": len(part.thrust),
        "dt": dt,
        "off": np.flatnonzero(~part.works).tolist(),
        "targets": [[step, scale.numbers(target)] for step, target in part.targets],
        "reached": base64.b64encode(part.reached.astype(np.uint8).tobytes()).decode(),
        **packed_cuts(part.parted),
        **scale.packed(),
        **packed_motion(scale, part.position, part.angle, part.thrust, part.distance),
    }
