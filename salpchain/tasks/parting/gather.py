"""`gather`: units that are scattered singly or in pairs must become one chain in a pose."""

import equinox as eqx
import jax.numpy as jnp
import jax.random as jr
from jaxtyping import Array, PRNGKeyArray

from salpchain.physics.state import Physics
from salpchain.tasks.parting.config import GatherConfig
from salpchain.tasks.parting.course import Parting, gentle_pose, open_water, straight
from salpchain.tasks.state import Start

SPACING = 0.45  # m, along the ring from one group to the next (chosen)
CLEAR = 0.6  # m, between the ring and the circle round the target, at least (chosen)


class Gather(Parting):
    """Groups of `group` units stand on a ring round the target, in random directions.

    Each unit of a group alone pushes one way through its own middle: it cannot turn, but for the
    link that hangs on it.
    """

    config: GatherConfig = eqx.field(default_factory=GatherConfig, static=True)

    def begin(
        self, key: PRNGKeyArray, draw_key: PRNGKeyArray, length: int | Array, physics: Physics
    ) -> Start:
        """Groups in a random order of places on the ring, and a target of wide arcs."""
        del key
        slots, link, group = self.config.length, physics.link_length, self.config.group
        where_key, turn_key, pose_key = jr.split(draw_key, 3)
        slot = jnp.arange(slots)
        which = slot // group
        groups = (length + group - 1) // group
        drawn = jnp.where(slot < groups, jr.uniform(where_key, (slots,)), 2.0)
        place = jnp.argsort(jnp.argsort(drawn))[which]
        radius = jnp.maximum(groups * SPACING / (2 * jnp.pi), length * link / 2 + CLEAR)
        bearing = 2 * jnp.pi * place / groups
        centre = radius * jnp.stack([jnp.cos(bearing), jnp.sin(bearing)], axis=-1)
        angle = jr.uniform(turn_key, (slots,), maxval=2 * jnp.pi)[which]
        size = jnp.minimum(group, length - which * group)
        offset = (slot % group - (size - 1) / 2) * link
        chain = straight(centre, angle, offset, length, which[1:] == which[:-1])
        chance = jr.uniform(pose_key, (5,))
        pose = gentle_pose(chance, jnp.zeros(2), slots, length, link)
        return Start(self.prepared(chain), pose, open_water())
