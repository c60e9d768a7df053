"""The Salp Chain Locomotion Domain: a chain of thrusting units must take a target pose.

Source: paper section 3.1.
"""

from collections.abc import Mapping

import jax.random as jr
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from salpchain.dynamics.robot import scale_of, settled
from salpchain.physics.batching import where
from salpchain.physics.state import Chain, Physics
from salpchain.tasks.reach.folds import folded, stalled
from salpchain.tasks.reach.reward import own_progress, reached, reward_terms
from salpchain.tasks.reach.targets import draw, spawn, target_pose
from salpchain.tasks.state import Judgement, Moment, Start, State
from salpchain.tasks.task import Task


class SCLD(Task):
    """The paper's task: the chain starts straight and at rest and must take a random pose."""

    @property
    def weights(self) -> Mapping[str, float]:
        """The paper's reward, and the shaping term by its weight (equations 6 and 7)."""
        return {"approach": 1.0, "goal": 1.0, "fine": self.config.fine_weight}

    @property
    def scale(self) -> float:
        """How many times longer links are than the paper's: 1 of the paper's own dynamics."""
        return scale_of(self.physics)

    def begin(
        self, key: PRNGKeyArray, draw_key: PRNGKeyArray, length: int | Array, physics: Physics
    ) -> Start:
        """A straight chain, or a folded one in the fractions that the settings ask for."""
        slots, chance = self.config.length, draw(draw_key)
        chain = spawn(chance, slots, length, physics)
        target = target_pose(chance, slots, length, physics)
        if self.config.folded + self.config.stalled > 0:
            chain = settled(physics, self._folded(key, chain, target, length, physics))
        return Start(chain, target)

    def _folded(
        self,
        key: PRNGKeyArray,
        chain: Chain,
        target: Array,
        length: int | Array,
        physics: Physics,
    ) -> Chain:
        """The chain, folded or stalled in the fractions of episodes that the settings ask for."""
        which, how = jr.split(jr.fold_in(key, 1))
        chance, share = jr.uniform(which), self.config.folded
        chain = where(chance < share, folded(how, chain, length, physics), chain)
        is_stalled = (share <= chance) & (chance < share + self.config.stalled)
        return where(is_stalled, stalled(how, chain, target, length, physics), chain)

    def judge(self, before: State, after: Moment) -> Judgement:
        """The reward terms; the episode ends once the target pose is taken."""
        tolerance = self.config.tolerance * self.scale
        goal = reached(after.chain, after.target, tolerance) & after.valid
        return Judgement(reward_terms(before.distances, after.distances, goal, self.scale), goal)

    def credit(self, before: State, after: State) -> Float[Array, " unit"]:
        """How much more each unit drew near to its own target point than the mean unit did."""
        fine = self.config.fine_weight
        return own_progress(before.chain, after.chain, after.target, fine, self.scale)

    def is_scored(self, state: State) -> Bool[Array, ""]:
        """False for episodes that start on their target, as stalled ones may."""
        return state.start_distance > self.config.tolerance * self.scale
