"""The robot's side of a policy: NumPy and onnxruntime, no JAX. `swim` is the loop.

python examples/robot.py POLICY.onnx

Units of a chain are numbered along it. Positions in metres, velocities in metres a second, angles
in radians and anticlockwise, all in one fixed frame of your choice, such as that of a camera: the
policy sees nothing of where its origin is or how it is turned. A unit's angle is that of its axis
along the chain; it pushes along its heading, 90 degrees anticlockwise of that, in newton.
"""

import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import onnxruntime

LINK = 0.07  # m, between neighbouring units
SENSED = 0.2  # m, as far as `proximity` senses other units
POSES = ("position", "angle", "velocity", "angular velocity", "target")


def body_observation(
    position: np.ndarray,  # (n, 2) m
    angle: np.ndarray,  # (n,) rad
    velocity: np.ndarray,  # (n, 2) m/s
    angular_velocity: np.ndarray,  # (n,) rad/s
    target: np.ndarray,  # (n, 2) m, one point for each unit
) -> np.ndarray:
    """The observation `body` of every unit, (n, 22): every vector in the unit's own axes."""
    axis = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    heading = np.stack([-axis[:, 1], axis[:, 0]], axis=1)
    error, beside = target - position, position - position.mean(axis=0)
    far = np.hypot(*error.T)[:, None]
    vectors = [
        5 * velocity,
        *neighbours(position),
        *neighbours(target),
        error / (far + 0.01),
        np.broadcast_to(5 * velocity.mean(axis=0), error.shape),
        beside / (np.sqrt((beside**2).sum(axis=1).mean()) + 0.01),
        error,
        np.broadcast_to(target.mean(axis=0) - position.mean(axis=0), error.shape),
    ]
    own = [(vector * side).sum(axis=1) for vector in vectors for side in (axis, heading)]
    own[-4:] = [np.sign(x) * np.log1p(5 * np.abs(x)) for x in own[-4:]]
    place = np.linspace(-1, 1, len(angle))
    return np.stack([*own, angular_velocity / 3, place], axis=1).astype(np.float32)


def proximity_observation(*poses: np.ndarray) -> np.ndarray:
    """The observation `proximity`, (n, 24): `body`, and the nearest unit that is no neighbour."""
    position, angle = poses[0], poses[1]
    near, along, heading = nearest(position), np.cos(angle), np.sin(angle)
    own = along * near[:, 0] + heading * near[:, 1], along * near[:, 1] - heading * near[:, 0]
    return np.column_stack([body_observation(*poses), *own]).astype(np.float32)


OBSERVATIONS = {"body": body_observation, "proximity": proximity_observation}


def nearest(position: np.ndarray) -> np.ndarray:
    """Direction to each unit's nearest that is no neighbour, (n, 2): 2 (1 - distance / 0.2 m)."""
    offset = position - position[:, None]
    apart, unit = np.hypot(offset[..., 0], offset[..., 1]), np.arange(len(position))
    apart[np.abs(unit[:, None] - unit) <= 1] = np.inf
    which = apart.argmin(axis=1)
    least = apart[unit, which][:, None]
    length = 2 * np.maximum(0.0, 1 - least / SENSED)
    return np.where(length > 0, offset[unit, which] / np.maximum(least, 1e-6) * length, 0.0)


def neighbours(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """From each point to the previous and to the next, in links; zero at the ends."""
    steps, none = np.diff(points, axis=0) / LINK, np.zeros((1, 2))
    return np.concatenate([none, -steps]), np.concatenate([steps, none])


def thrusts(session: Any, *poses: np.ndarray) -> np.ndarray:
    """Thrust (n,) in newton of every unit along its heading, for the next 0.1 s.

    Args:
        session: of onnxruntime, of a policy whose observation is one of `OBSERVATIONS`.
        *poses: what `body_observation` takes.

    Raises:
        ValueError: a pose of another shape, or one that is not finite, such as that of a lost
            marker: send no thrust then.
    """
    units = len(poses[1])
    for what, given, shape in zip(POSES, poses, ((2,), (), (2,), (), (2,)), strict=True):
        if np.shape(given) != (units, *shape) or not np.isfinite(given).all():
            raise ValueError(f"{what} must be {(units, *shape)} finite numbers, got {given}")
    observe = OBSERVATIONS[session.get_modelmeta().custom_metadata_map["observation"]]
    return session.run(["thrust"], {"observation": observe(*poses)[None]})[0][0]


def opened(path: str, units: int) -> Any:
    """The session of onnxruntime for a policy of `OBSERVATIONS` that can steer so many units.

    Raises:
        ValueError: the file is of another policy.
    """
    session = onnxruntime.InferenceSession(path)
    about = session.get_modelmeta().custom_metadata_map
    if about.get("observation") not in OBSERVATIONS:
        known = " or ".join(OBSERVATIONS)
        raise ValueError(f"{path} must be of a policy that sees {known}, not {about}")
    if about["serves_units"] not in ("any", str(units)):
        raise ValueError(f"{path} steers {about['serves_units']} units, the robot has {units}")
    return session


def swim(session: Any, read: Callable[[], Any], send: Callable[[Any], None], steps: int) -> None:
    """So many control steps, in time: `read` gives poses, `send` takes thrusts (n,) in newton.

    Where a pose cannot be used, the thrusts are zero.
    """
    period = float(session.get_modelmeta().custom_metadata_map["control_step_seconds"])
    due = time.monotonic()
    for _ in range(steps):
        poses = read()
        try:
            send(thrusts(session, *poses))
        except ValueError as error:
            print(f"no thrust: {error}", file=sys.stderr)
            send(np.zeros(len(poses[1])))
        due += period
        time.sleep(max(0.0, due - time.monotonic()))


def main() -> None:
    """One second of a chain of 8 units that stands still. Put your own `read` and `send` here."""
    if len(sys.argv) != 2:
        sys.exit("usage: python examples/robot.py POLICY.onnx (of: salpchain export POLICY)")
    place, still = np.arange(8)[:, None] * [LINK, 0.0], np.zeros(8)
    poses = place, still, np.zeros((8, 2)), still, place + np.array([0.5, 0.5])
    try:
        swim(opened(sys.argv[1], 8), lambda: poses, print, 10)
    except (ValueError, onnxruntime.capi.onnxruntime_pybind11_state.NoSuchFile) as error:
        sys.exit(f"robot: {error}")


if __name__ == "__main__":
    main()
