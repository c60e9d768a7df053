"""The drag-dominated chain written from its equations alone: NumPy, float64, dense matrices.

Configuration q: the first link's middle and direction, then the joint angles. For q' the motion of
frame k of link i is J_k q', told in the frame's own axes.
"""

import numpy as np


class Dense:
    """A chain of links, each (jet degrees, (x, y) of the jet, drag, on_wheel)."""

    def __init__(self, links, joint_drag, length=0.272, sets_speed=False, stiffness=0.0):
        self.links, self.length, self.sets_speed = links, length, sets_speed
        self.joint_drag, self.stiffness = np.asarray(joint_drag, float), stiffness
        self.n = len(links)

    def directions(self, q):
        return q[2] + np.concatenate([[0.0], np.cumsum(q[3:])])

    def middles(self, q):
        angle = self.directions(q)
        half = self.length / 2 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        steps = np.concatenate([np.zeros((1, 2)), half[1:] + half[:-1]])
        return q[:2] + np.cumsum(steps, axis=0)

    def jacobian(self, q, link, at, turn):
        """The motion of a frame of a link, along, across and turning, for each q'."""
        angle, n = self.directions(q), self.n
        by_angle = np.zeros((2, n))  # of the point, for the turning of each link
        for other in range(n):
            across = np.array([-np.sin(angle[other]), np.cos(angle[other])])
            if 0 < other < link or other == 0 < link:
                by_angle[:, other] += self.length * across * (0.5 if other == 0 else 1.0)
            if other == link > 0:
                by_angle[:, other] += self.length / 2 * across
        c, s = np.cos(angle[link]), np.sin(angle[link])
        arm = np.array([c * at[0] - s * at[1], s * at[0] + c * at[1]])
        by_angle[:, link] += [-arm[1], arm[0]]
        sums = np.tril(np.ones((n, n)))  # the links' directions for q[2:]
        world = np.concatenate([np.eye(2), by_angle @ sums], axis=1)
        axis = angle[link] + turn
        own = np.array([[np.cos(axis), np.sin(axis)], [-np.sin(axis), np.cos(axis)]])
        turning = np.concatenate([np.zeros(2), sums[link]])
        return np.concatenate([own @ world, turning[None]])

    def rate(self, q, u):
        """q' under what the jets set (m/s) or push with (N)."""
        n = self.n
        drag, push = np.zeros((n + 2, n + 2)), np.zeros(n + 2)
        for i, (jet, at, d, on_wheel) in enumerate(self.links):
            jet = np.radians(jet)
            wheel = self.jacobian(q, i, at, jet)
            frame = wheel if on_wheel else self.jacobian(q, i, (0.0, 0.0), 0.0)
            drag += frame.T @ np.diag(d) @ frame
            force = d[0] * u[i] if self.sets_speed else u[i]
            push += wheel.T @ [force, 0.0, 0.0]
        drag[3:, 3:] += np.diag(self.joint_drag)
        push[3:] -= self.stiffness * q[3:]
        return np.linalg.solve(drag, push)

    def swim(self, q, u_of, seconds, steps):
        """The configurations at all steps, by Runge and Kutta's method of fourth order."""
        dt, path = seconds / steps, [q]
        for step in range(steps):
            t = step * dt
            k1 = self.rate(q, u_of(t))
            k2 = self.rate(q + dt / 2 * k1, u_of(t + dt / 2))
            k3 = self.rate(q + dt / 2 * k2, u_of(t + dt / 2))
            k4 = self.rate(q + dt * k3, u_of(t + dt))
            q = q + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            path.append(q)
        return np.array(path)
