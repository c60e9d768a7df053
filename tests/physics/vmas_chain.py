"""Chains in the real VMAS, and start poses shared by the tests of the physics."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from salpchain.physics.state import Bodies, Chain

torch = pytest.importorskip("torch")
torch.set_num_threads(1)  # VMAS's arrays are tiny here; more threads only wait for each other

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

    def __init__(self, position, angle, fence=None, collide=True, walls=(), posts=()):
        """Walls are ((x, y), (x, y), width), posts are ((x, y), radius), in m."""
        batch, num = angle.shape
        self.world = core.World(batch, "cpu", x_semidim=fence, y_semidim=fence, **WORLD)
        self.units = [_unit(index, collide) for index in range(num)]
        for unit in self.units:
            self.world.add_agent(unit)
        self.joints = [_joint(*pair) for pair in zip(self.units, self.units[1:], strict=False)]
        for joint in self.joints:
            self.world.add_joint(joint)
        for entity, place, turn in [*map(_wall, walls), *map(_post, posts)]:
            self.world.add_landmark(entity)
            entity.set_pos(_tensor(place).expand(batch, 2), None)
            entity.set_rot(_tensor([turn]).expand(batch, 1), None)
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
        with torch.inference_mode():
            self.world.step()

    def record_contact(self):
        """A list to which every substep from now on adds the largest contact force (N)."""
        world, forces = self.world, []
        collide = world._box_box_vectorized_collision

        def recording(pairs):
            before = dict(world.forces_dict)
            collide(pairs)
            change = [world.forces_dict[unit] - before[unit] for unit in self.units]
            forces.append(max(float(force.norm(dim=-1).max()) for force in change))

        world._box_box_vectorized_collision = recording
        return forces

    def box_on_box(self):
        """Contact force (2, batch) N on the first of two, torques (batch,) N m on both."""
        world, units = self.world, self.units[:2]
        world.forces_dict = {unit: torch.zeros_like(unit.state.pos) for unit in units}
        world.torques_dict = {unit: torch.zeros_like(unit.state.rot) for unit in units}
        world._box_box_vectorized_collision([tuple(units)])
        torques = (world.torques_dict[unit].numpy()[:, 0] for unit in units)
        return world.forces_dict[units[0]].numpy().T, *torques

    @property
    def position(self):
        """Positions of the units, (batch, unit, 2) m."""
        return np.stack([unit.state.pos.numpy() for unit in self.units], 1)

    @property
    def chain(self) -> Chain:
        """The state now as a batch of our chains."""
        links = [joint.landmark for joint in self.joints]
        rest = [[side.fixed_rotation for side in j.joint_constraints] for j in self.joints]
        rest = np.stack([np.concatenate(sides, 1) for sides in rest], 1)
        return jax.vmap(_chain)(_fields(self.units), _fields(links), rest)


def box_on_sphere(offset, angle, radius):
    """Force (2, pair) N and torque (pair,) N m on a unit at the origin by a sphere at an offset."""
    world, unit, sphere = (
        core.World(len(angle), "cpu", **WORLD),
        _unit(0, True),
        _post(((), radius))[0],
    )
    world.add_agent(unit)
    world.add_landmark(sphere)
    unit.set_rot(_tensor(angle[:, None]), None)
    unit.set_pos(_tensor(0 * offset.T), None)
    sphere.set_pos(_tensor(offset.T), None)
    both = (unit, sphere)
    world.forces_dict = {body: torch.zeros_like(body.state.pos) for body in both}
    world.torques_dict = {body: torch.zeros_like(body.state.rot) for body in both}
    world._box_sphere_vectorized_collision([both])
    return world.forces_dict[unit].numpy().T, world.torques_dict[unit].numpy()[:, 0]


def _chain(units, links, rest_angle) -> Chain:
    present = jnp.ones(units[1].shape, bool)
    return Chain(
        Bodies(*units), Bodies(*links), rest_angle, present, present[1:], jnp.zeros((), bool)
    )


def _tensor(array):
    return torch.tensor(np.asarray(array, np.float32))


def _unit(index, collide):
    box = core.Box(length=0.04, width=0.05)
    return core.Agent(name=f"unit {index}", shape=box, mass=1.0, rotatable=True, collide=collide)


def _wall(wall):
    """A landmark, and where it stands and how it is turned."""
    (ax, ay), (bx, by), width = wall
    box = core.Box(length=float(np.hypot(bx - ax, by - ay)), width=width)
    return _landmark(box, wall), [(ax + bx) / 2, (ay + by) / 2], np.arctan2(by - ay, bx - ax)


def _post(post):
    centre, radius = post
    return _landmark(core.Sphere(radius=radius), post), centre, 0.0


def _landmark(shape, name):
    return core.Landmark(name=str(name), shape=shape, movable=False, rotatable=False, collide=True)


def _joint(first, second):
    return joints.Joint(
        first, second, rotate_a=False, rotate_b=False, dist=0.07, collidable=False, mass=1.0
    )


def _fields(entities):
    """Position, angle, velocity and angular velocity, (batch, body, ...)."""
    names = ("pos", "rot", "vel", "ang_vel")
    values = [np.stack([getattr(e.state, n).numpy() for e in entities], 1) for n in names]
    position, angle, velocity, spin = values
    return position, angle[..., 0], velocity, spin[..., 0]
