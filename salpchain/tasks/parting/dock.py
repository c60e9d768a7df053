"""`dock`: two chains must join end to end and hold a pose."""

import equinox as eqx
import jax.numpy as jnp
import jax.random as jr
from jaxtyping import Array, PRNGKeyArray

from salpchain.physics.state import Physics
from salpchain.tasks.parting.config import DockConfig
from salpchain.tasks.parting.course import Parting, gentle_pose, open_water, straight
from salpchain.tasks.state import Start

CLEAR = 0.3  # m, between the circles round the target and round the chains (chosen)


class Dock(Parting):
    """The first half of the units is one chain, the second another, both straight and at rest.

    The circles round them are `apart` from each other; the target lies beside the line between
    their centres, clear of both. The joined chain must hold it for `hold` seconds.
    """

    config: DockConfig = eqx.field(default_factory=DockConfig, static=True)

    def begin(
        self, key: PRNGKeyArray, draw_key: PRNGKeyArray, length: int | Array, physics: Physics
    ) -> Start:
        """Two chains in random directions, and a target of wide arcs in another."""
        del key
        chance = jr.uniform(draw_key, (10,))
        slots, link = self.config.length, physics.link_length
        slot, first = jnp.arange(slots), length // 2
        is_second = slot >= first
        size = jnp.where(is_second, length - first, first)
        place = slot - jnp.where(is_second, first, 0)
        circle = jnp.stack([first, length - first]) * (link / 2)
        half = (circle.sum() + self.config.apart) / 2
        turn = 2 * jnp.pi * chance[0]
        across = jnp.stack([jnp.cos(turn), jnp.sin(turn)])
        away = jnp.stack([-across[1], across[0]]) * jnp.where(chance[1] < 0.5, -1.0, 1.0)
        angle = 2 * jnp.pi * jnp.where(is_second, chance[2], chance[3])
        centre = jnp.where(is_second, 1.0, -1.0)[:, None] * half * across
        chain = straight(centre, angle, (place - (size - 1) / 2) * link, length, slot[1:] != first)
        target = away * (length * link / 2 + circle.max() + CLEAR)
        pose = gentle_pose(chance[4:9], target, slots, length, link)
        return Start(self.prepared(chain), pose, open_water())
