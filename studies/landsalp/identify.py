"""Three links in water, with where their jets point identified: NumPy, dense, many at once.

The law is that of `salpchain.dynamics.water`, written again with the joints' forces as unknowns.
"""

import numpy as np
from jaxtyping import Float

from salpchain.dynamics.landsalp import JETS, LINK
from salpchain.dynamics.water import CRUISE, WIDTH, Water, body, quadratic
from studies.landsalp.chains import CROOKED, RUNS, SECONDS

MASS, SQUARES = np.array(body(LINK, WIDTH)), np.array(quadratic(LINK, WIDTH))
LINEAR = np.array(Water.parts[0].drag)
AT = np.array([JETS[i][1] for i in (0, 1, 0)])  # m, of the jets
STEP, SUBSTEPS, JOINT, LAG = 0.1 * (LINK / 0.07) * (0.2 / CRUISE), 12, 1e-4, 0.2
ANGLES = np.arange(0, 360, 20)  # degrees from the link, of all jets (chosen)
PUSHES = np.geomspace(0.006, 0.2, 9)  # N (chosen)
KNOWN = ("all", "front alone")  # the runs that identify; the others are predicted

Cases = Float[np.ndarray, " case"]


def identify() -> None:
    """Print, for two ways to tell a speed and for a middle jet that is mirrored or not, the angle
    and push of the jets that two runs give, and what they predict for the other two."""
    angle, push = (grid.ravel() for grid in np.meshgrid(np.radians(ANGLES), PUSHES, indexing="ij"))
    measured = {name: speed for name, (_, speed, _) in RUNS.items() if speed}
    for mirrored in (False, True):
        jets = np.stack([angle, -angle if mirrored else angle, angle], axis=1)
        told = {name: swim(jets, push, np.array(on)) for name, (on, _, _) in RUNS.items()}
        for which, words in enumerate(("on its way", "straight")):
            shares = {name: told[name][which] / speed for name, speed in measured.items()}
            best = np.max([np.abs(shares[name] - 1) for name in KNOWN], axis=0).argmin()
            parts = ", ".join(f"{name} {share[best]:.2f}" for name, share in shares.items())
            print(
                f"middle jet {'mirrored' if mirrored else 'as the others'}, speed {words}:"
                f" {np.degrees(angle[best]):.0f} degrees, {push[best]:.3f} N; speeds over measured:"
                f" {parts}; back alone turns {told['back alone'][2][best]:.0f} degrees"
            )


def swim(jets: Float[np.ndarray, "case 3"], push: Cases, on: np.ndarray) -> tuple[Cases, ...]:
    """Speed along the way, straight speed (m/s), both in the second half, and turn (degrees)."""
    angle = np.tile([0.0, CROOKED, 0.0], (len(push), 1))
    place, motion = laid(np.zeros((len(push), 3, 2)), angle), np.zeros((len(push), 3, 3))
    share, first, path = np.zeros(3), angle.mean(axis=1), []
    for _ in range(round(SECONDS / STEP)):
        for _ in range(SUBSTEPS):
            share = on + np.exp(-STEP / SUBSTEPS / LAG) * (share - on)
            place, angle, motion = substep(place, angle, motion, jets, push[:, None] * share)
        place = laid(place, angle)
        path.append(place.mean(axis=1))
    late = np.stack(path[len(path) // 2 :], axis=1)
    seconds = (late.shape[1] - 1) * STEP
    way = np.linalg.norm(np.diff(late, axis=1), axis=2).sum(axis=1) / seconds
    straight = np.linalg.norm(late[:, -1] - late[:, 0], axis=1) / seconds
    return way, straight, np.degrees(angle.mean(axis=1) - first)


def laid(place: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """The links' middles (m) end to end, the first where it is."""
    half = LINK / 2 * np.stack([np.cos(angle), np.sin(angle)], axis=2)
    steps = np.concatenate([place[:, :1], half[:, :-1] + half[:, 1:]], axis=1)
    return np.cumsum(steps, axis=1)


def substep(
    place: np.ndarray, angle: np.ndarray, motion: np.ndarray, jets: np.ndarray, force: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places (m), angles (rad) and motions (m/s, rad/s) of the links a substep later."""
    dt, axes = STEP / SUBSTEPS, frames(angle)
    momentum = carried(axes, MASS[:2], motion[..., :2])
    munk = motion[..., 0] * momentum[..., 1] - motion[..., 1] * momentum[..., 0]
    place, angle = place + dt * motion[..., :2], angle + dt * motion[..., 2]
    axes = frames(angle)
    own = np.concatenate([axes @ motion[..., :2, None], motion[..., 2:, None]], axis=2)[..., 0]
    drag = MASS / dt + LINEAR + SQUARES * np.abs(own)
    push = force[..., None] * np.stack([np.cos(angle + jets), np.sin(angle + jets)], axis=2)
    arm = np.einsum("blki,lk->bli", axes, AT)
    torque = MASS[2] * motion[..., 2] / dt - munk
    torque = torque + arm[..., 0] * push[..., 1] - arm[..., 1] * push[..., 0]
    load = np.concatenate([momentum / dt + push, torque[..., None]], axis=2)
    return place, angle, joined(axes, drag, load)


def frames(angle: np.ndarray) -> np.ndarray:
    """The links' own axes as rows, along and across."""
    cos, sin = np.cos(angle), np.sin(angle)
    return np.stack([np.stack([cos, sin], axis=-1), np.stack([-sin, cos], axis=-1)], axis=-2)


def carried(axes: np.ndarray, sizes: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Sizes along and across the links times velocities, in world axes."""
    return np.einsum("...ki,...k,...kj,...j->...i", axes, sizes, axes, velocity)


def joined(axes: np.ndarray, drag: np.ndarray, load: np.ndarray) -> np.ndarray:
    """The motions at which drag meets the load and no joint opens."""
    cases = len(load)
    matrix, right = np.zeros((cases, 13, 13)), np.zeros((cases, 13))
    right[:, :9] = load.reshape(cases, 9)
    for link in range(3):
        at = slice(3 * link, 3 * link + 2)
        own = axes[:, link]
        matrix[:, at, at] = np.einsum("bki,bk,bkj->bij", own, drag[:, link, :2], own)
        matrix[:, 3 * link + 2, 3 * link + 2] = drag[:, link, 2]
    for joint in range(2):
        one, other, force = 3 * joint, 3 * joint + 3, slice(9 + 2 * joint, 11 + 2 * joint)
        rows = np.zeros((cases, 2, 13))
        rows[:, :, one : one + 2], rows[:, :, other : other + 2] = np.eye(2), -np.eye(2)
        rows[:, :, one + 2] = LINK / 2 * axes[:, joint, 1]
        rows[:, :, other + 2] = LINK / 2 * axes[:, joint + 1, 1]
        matrix[:, force], matrix[:, :, force] = rows, np.swapaxes(rows, 1, 2)
        for a, b, sign in ((one, one, 1), (other, other, 1), (one, other, -1), (other, one, -1)):
            matrix[:, a + 2, b + 2] += sign * JOINT
    return np.linalg.solve(matrix, right[..., None])[:, :9, 0].reshape(cases, 3, 3)
