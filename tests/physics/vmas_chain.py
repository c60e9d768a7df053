"""Chains in the real VMAS, and start poses shared by the tests of the physics."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from salpchain.physics.chain import Bodies, Chain

torch = pytest.importorskip("torch")
core = pytest.importorskip("vmas.simulator.core")
joints = pytest.importorskip("vmas.simulator.joints")

# The paper's world (shared/DESIGN.md, section 3).
WORLD = {
    "dt": 0.1,  # s
    "substeps": 15,
    "joint_force": 900,  # N/m
    "torque_constraint_force": 0.1,  # N m
    "collision_force": 1500,  # N/m
}


class VmasChains:
    """A batch of chains of one length in a VMAS world, stepped by VMAS's own `World.step`.

    VMAS looks at a pair of units in the whole batch as soon as their bounding circles meet in one
    of its environments (`World.collides` takes `.any()`), so contact in one environment can depend
    on the others. Ours decides for each chain: where contact matters, compare with batches of one.
    """

    def __init__(self, position, angle, fence=None, collide=True):
        batch, num = angle.shape
        self.world = core.World(batch, "cpu", x_semidim=fence, y_semidim=fence, **WORLD)
        self.units = [_unit(index, collide) for index in range(num)]
        for unit in self.units:
            self.world.add_agent(unit)
        self.joints = [_joint(*pair) for pair in zip(self.units, self.units[1:], strict=False)]
        for joint in self.joints:
            self.world.add_joint(joint)
        self._place(position, angle)

    def _place(self, position, angle):
        """Angles first: VMAS infers a joint's rest angle whenever one of its units is placed."""
        for index, unit in enumerate(self.units):
            unit.set_rot(_tensor(angle[:, index, None]), None)
        for index, unit in enumerate(self.units):
            unit.set_pos(_tensor(position[:, index]), None)

    def step(self, thrust):
        """Advance one control step under a thrust (batch, unit) along the units' headings."""
        for index, unit in enumerate(self.units):
            heading = unit.state.rot[:, 0] + np.pi / 2
            across = torch.stack([heading.cos(), heading.sin()], -1)
            unit.state.force = _tensor(thrust[:, index, None]) * across
        self.world.step()

    @property
    def position(self):
        """Positions of the units, (batch, unit, 2) m."""
        return np.stack([unit.state.pos.numpy() for unit in self.units], 1)

    @property
    def chain(self) -> Chain:
        """The state now as a batch of our chains."""
        links = [joint.landmark for joint in self.joints]
        rest = [[side.fixed_rotation for side in j.joint_constraints] for j in self.joints]
        ones = np.ones((self.world.batch_dim, len(self.units)), bool)
        return Chain(
            units=_bodies(self.units),
            links=_bodies(links),
            rest_angle=jnp.array(np.stack([np.concatenate(r, 1) for r in rest], 1)),
            present=jnp.array(ones),
            linked=jnp.array(ones[:, 1:]),
        )


def _tensor(array):
    return torch.tensor(np.asarray(array, np.float32))


def _unit(index, collide):
    box = core.Box(length=0.04, width=0.05)
    return core.Agent(name=f"unit {index}", shape=box, mass=1.0, rotatable=True, collide=collide)


def _joint(first, second):
    return joints.Joint(
        first, second, rotate_a=False, rotate_b=False, dist=0.07, collidable=False, mass=1.0
    )


def _bodies(entities) -> Bodies:
    fields = ("pos", "rot", "vel", "ang_vel")
    values = [np.stack([getattr(e.state, f).numpy() for e in entities], 1) for f in fields]
    position, angle, velocity, spin = values
    arrays = (position, angle[..., 0], velocity, spin[..., 0])
    return Bodies(*(jnp.array(array) for array in arrays))
