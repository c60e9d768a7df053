"""Trajectories made by hand."""

import numpy as np

from salpchain.evaluation.trajectory import Trajectory


def made(position, angle, target, success=True, policy="made", thrust=None, dt=0.1):
    """A trajectory through these unit poses, its links between them and nothing else known."""
    position, angle = np.asarray(position, float), np.asarray(angle, float)
    times, length = angle.shape
    ahead = np.diff(position, axis=1)
    link = np.arctan2(ahead[..., 1], ahead[..., 0])
    middle = (position[:, 1:] + position[:, :-1]) / 2
    thrust = np.zeros((times - 1, length)) if thrust is None else thrust
    still = np.zeros_like
    return Trajectory(
        policy, 0, 0, "fixed", length, dt, success, position, angle, still(position), still(angle),
        middle, link, still(middle), still(link), thrust, np.zeros(times - 1), np.asarray(target),
    )  # fmt: skip


def swim(length, bearing=0.4, times=40, policy="made"):
    """A chain that glides sideways to its target without turning."""
    along = np.array([np.cos(bearing), np.sin(bearing)])
    rest = 0.07 * np.arange(length)[:, None] * np.array([-np.sin(bearing), np.cos(bearing)])
    way = np.linspace(0, 0.2 * length, times)[:, None, None]
    positions = rest + way * along
    angles = np.full((times, length), bearing + np.pi / 2)
    thrust = np.tile(np.linspace(-1, 1, length), (times - 1, 1))
    return made(positions, angles, positions[-1] + 0.01 * along, policy=policy, thrust=thrust)
