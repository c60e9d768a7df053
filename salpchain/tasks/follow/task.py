"""`follow`: the target pose of `reach` moves along a smooth path at a constant speed."""

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import jax.random as jr
import numpy as np
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from salpchain.dynamics.robot import tempo_of
from salpchain.physics.state import Physics
from salpchain.tasks.follow.config import FollowConfig
from salpchain.tasks.reach.reward import told
from salpchain.tasks.reach.task import SCLD
from salpchain.tasks.state import Judgement, Moment, Start, State

NEAR = 0.1  # m, mean distance at which a chain has approached its target (chosen)
CLOSE = 0.05  # m, within which it is close
WAVES = (1.0, 1.7, 2.9)  # waves of the curvature in the length of 2 pi chains, not in tune (chosen)
STREAM = 5  # makes the path independent of the start


class Path(eqx.Module):
    """Where the target is on its way."""

    pose: Float[Array, "unit 2"]  # m, about its centroid, in the axes of the path
    centre: Float[Array, "2"]  # m
    direction: Float[Array, ""]  # rad, in which it moves
    way: Float[Array, ""]  # come so far, in lengths of the chain
    phase: Float[Array, " wave"]  # rad, of the waves of the curvature
    length: Float[Array, ""]  # m, of the chain


class Follow(SCLD):
    """The chain starts as in `reach`, and must come to the moving target and stay with it.

    The pose turns with its path, as a rigid body. An episode ends with its time.
    """

    config: FollowConfig = eqx.field(default_factory=FollowConfig, static=True)

    @property
    def weights(self) -> Mapping[str, float]:
        """The approach and its shaping as in `reach`, and how close the chain is in each step."""
        return {"approach": 1.0, "close": 0.1, "fine": self.config.fine_weight}

    def begin(
        self, key: PRNGKeyArray, draw_key: PRNGKeyArray, length: int | Array, physics: Physics
    ) -> Start:
        """A start of `reach`, and the path that its target will take."""
        start = super().begin(key, draw_key, length, physics)
        which, phases = jr.split(jr.fold_in(key, STREAM))
        direction = jr.uniform(which, maxval=2 * jnp.pi)
        centre = _centroid(start.chain.present, start.target)
        path = Path(
            pose=_turned(start.target - centre, -direction),
            centre=centre,
            direction=direction,
            way=jnp.zeros(()),
            phase=jr.uniform(phases, (len(WAVES),), maxval=2 * jnp.pi),
            length=jnp.asarray(length * physics.link_length, jnp.result_type(float)),
        )
        return Start(start.chain, start.target, path)

    def move(self, state: State) -> tuple[Float[Array, "unit 2"], Any]:
        """The pose one control step further on its path; it stands where it came by no path."""
        path = state.plan
        if path is None:
            return state.target, None
        physics = self.world_of(state).dynamics
        step = self.config.speed * (self.scale / tempo_of(physics)) * physics.control_step
        curvature = self.config.turning * jnp.sin(jnp.asarray(WAVES) * path.way + path.phase).mean()
        direction = path.direction + curvature * step / path.length
        ahead = jnp.stack([jnp.cos(direction), jnp.sin(direction)])
        centre = path.centre + step * ahead
        path = eqx.tree_at(
            lambda p: (p.centre, p.direction, p.way),
            path,
            (centre, direction, path.way + step / path.length),
        )
        return centre + _turned(path.pose, direction), path

    def judge(self, before: State, after: Moment) -> Judgement:
        """How much nearer the chain came, and how close it is: 1 at the target, 0.37 at 5 cm."""
        now, was = after.distances, before.distances
        close = jnp.exp(-now.mean / (CLOSE * self.scale))
        approach = told(was.mean - now.mean, self.scale)
        terms = {"approach": approach, "close": close, "fine": was.log - now.log}
        return Judgement(terms, jnp.zeros((), bool))

    def gauge(self, state: State) -> dict[str, Float[Array, ""]]:
        """The mean distance (m) of units to their target points."""
        return {"distance": state.distances.mean}

    def measure(self, series: Mapping[str, np.ndarray]) -> dict[str, float]:
        """Mean and 95th percentile of the distance (m) and shares of the time close to the target.

        All from the first control step on in which the mean distance is at most 10 cm; a chain that
        never comes so near has no distances, and was close for no time. Where links are longer
        than the paper's, so are these 5 and 10 cm.
        """
        close, near_by = CLOSE * self.scale, NEAR * self.scale
        distance = np.asarray(series["distance"], float)
        near = np.flatnonzero(distance <= near_by)
        since = distance[near[0] :] if len(near) else distance[:0]
        return {
            "approached": float(len(near) > 0),
            "steps_to_approach": float(near[0] + 1) if len(near) else np.nan,
            "tracking_distance": float(since.mean()) if len(since) else np.nan,
            "tracking_distance_p95": float(np.percentile(since, 95)) if len(since) else np.nan,
            "within_5cm": float((since <= close).mean()) if len(since) else 0.0,
            "within_10cm": float((since <= near_by).mean()) if len(since) else 0.0,
        }

    def is_scored(self, state: State) -> Bool[Array, ""]:
        """Every episode counts."""
        return jnp.ones((), bool)


def _centroid(present: Bool[Array, " unit"], points: Float[Array, "unit 2"]) -> Float[Array, "2"]:
    return jnp.where(present[:, None], points, 0.0).sum(axis=0) / present.sum()


def _turned(vectors: Float[Array, "unit 2"], angle: Float[Array, ""]) -> Float[Array, "unit 2"]:
    cosine, sine = jnp.cos(angle), jnp.sin(angle)
    x, y = vectors[:, 0], vectors[:, 1]
    return jnp.stack([cosine * x - sine * y, sine * x + cosine * y], axis=1)
