"""Gaits of LandSalp's three links: the published one, and some that are found."""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.optimize import minimize

from salpchain.dynamics.landsalp import PEAK, LandSalp

PERIOD = 6.0  # s, of the published gait
# m/s: mean, sine and cosine parts of each jet's speed, as published with LandSalp
PUBLISHED = np.array(
    [[-0.0023, -0.0038, -0.0011], [-0.1135, 0.0133, 0.0480], [0.0415, 0.0508, 0.0246]]
)
# Found for the published period from its numbers on, by the largest bend (degrees): parts (m/s) and
# the joints (degrees) when a cycle begins. Sequential quadratic programming with jets to 0.1226 m/s
# and joints to 10.36 and 44.8 degrees, so that both hold between the moments looked at, too.
FOUND = {
    10.4: (
        [[-0.00613, -0.01038, -0.00405], [-0.10788, 0.04305, 0.09412], [0.04469, 0.10394, 0.07204]],
        [10.2231, 1.9495],
    ),
    45.0: (
        [[-0.00775, -0.00831, -0.00662], [-0.11081, 0.01782, 0.11307], [0.03043, 0.11283, 0.02715]],
        [43.4183, -29.7968],
    ),
}
ROUNDING = 5e-5  # m/s, half of the last digit that was published
BEND = 10.4  # degrees, the largest that the published gait bends a joint
STEPS = 240  # of a cycle (chosen)
GRID = 61  # shapes along each joint angle that are looked at (chosen)


class Cycle(NamedTuple):
    """What one cycle of a gait does."""

    way: Float[Array, "2"]  # m, of the mean of the links' middles: along the chain, and across it
    turn: Any  # rad, of the mean direction
    bends: Float[Array, "step joint"]  # rad, joint angles after each step
    change: Float[Array, " joint"]  # rad, from the first to the last

    @property
    def largest(self) -> Any:
        """The largest joint angle (rad)."""
        return jnp.abs(self.bends).max()

    @property
    def length(self) -> Any:
        """How far it came (m)."""
        return jnp.sqrt(self.way @ self.way)


def speeds(parts: Float[Array, "part unit"], phase: Any) -> Float[Array, " unit"]:
    """What the jets set (m/s): a mean, then sine and cosine parts of each harmonic."""
    speed = parts[0]
    for number in range(1, (len(parts) + 1) // 2):
        sine, cosine = jnp.sin(number * phase), jnp.cos(number * phase)
        speed = speed + parts[2 * number - 1] * sine + parts[2 * number] * cosine
    return speed


def cycle(parts: Array, bends: Array, period: Any = PERIOD, steps: int = STEPS) -> Cycle:
    """One cycle from these joint angles, the jets held in each step as in its middle."""
    robot = LandSalp.robot(jet=1.0, control_step=period / steps, substeps=1)
    begun = robot.straight(3, bends)

    def step(chain: Any, index: Array) -> tuple[Any, Array]:
        chain = robot.advance(chain, speeds(parts, 2 * jnp.pi * (index + 0.5) / steps))
        return chain, jnp.diff(robot.directions(chain))

    ended, passed = jax.lax.scan(step, begun, jnp.arange(steps))
    x, y = ended.units.position.mean(axis=0) - begun.units.position.mean(axis=0)
    axis = robot.directions(begun).mean()
    way = jnp.stack([jnp.cos(axis) * x + jnp.sin(axis) * y, jnp.cos(axis) * y - jnp.sin(axis) * x])
    turn = (robot.directions(ended) - robot.directions(begun)).mean()
    return Cycle(way, turn, passed, passed[-1] - bends)


def published() -> None:
    """Print what the published gait does, as it was printed and within the rounding of that."""
    with jax.enable_x64(True):
        _tell_published()


def _tell_published() -> None:
    run = jax.jit(cycle)
    _tell("as published, from straight", run(jnp.asarray(PUBLISHED), jnp.zeros(2)))
    parts = within_rounding()
    off = np.abs(np.asarray(parts) - PUBLISHED).max()
    _tell("the nearest numbers that repeat", run(parts, jnp.zeros(2)))
    print(f"{'':34} each within {off:.1e} m/s of the published one, whose rounding is {ROUNDING:g}")


def within_rounding() -> Float[Array, "part unit"]:
    """The numbers nearest to the published ones whose shape repeats itself from straight, without a
    turn."""

    def wrong(off: Array) -> Array:
        told = cycle(jnp.asarray(PUBLISHED) + ROUNDING * off.reshape(3, 3), jnp.zeros(2))
        return jnp.concatenate([told.change, told.turn[None]])

    value, slope, off = jax.jit(wrong), jax.jit(jax.jacfwd(wrong)), jnp.zeros(9)
    for _ in range(6):  # Gauss and Newton's steps to the nearest solution
        by = slope(off)
        off = jnp.linalg.pinv(by) @ (by @ off - value(off))
    return jnp.asarray(PUBLISHED) + ROUNDING * off.reshape(3, 3)


def _tell(name: str, told: Cycle, period: float = PERIOD) -> None:
    turn, bend = np.degrees(float(told.turn)) / period, np.degrees(float(told.largest))
    way, (along, across) = 1e3 * float(told.length), np.asarray(told.way)
    print(
        f"{name:34} {way:.2f} mm in a cycle of {period:.2f} s ({way / period:.2f} mm/s),"
        f" {np.degrees(np.arctan2(across, along)):.0f} degrees from the chain's axis,"
        f" turn {turn:.1e} degrees/s, joints at most {bend:.2f} degrees"
    )


def found() -> None:
    """Print what gaits do that were found for the published period, peak and way."""
    with jax.enable_x64(True):
        run = jax.jit(partial(cycle, steps=2 * STEPS))
        for bend, gait in FOUND.items():
            parts, bends = jnp.asarray(gait[0]), jnp.radians(jnp.asarray(gait[1]))
            _tell(f"found, joints to {bend:g} degrees", run(parts, bends))
            peak = (jnp.abs(parts[0]) + jnp.hypot(parts[1], parts[2])).max()
            grows = np.abs(np.linalg.eigvals(_after(parts, bends, jnp.asarray(PERIOD)))).max()
            print(f"{'':34} peak {peak:.4f} m/s, an error of shape {grows:.2f} times a cycle later")


def search() -> None:
    """Print the fastest gaits found under the published peak, by bend and direction."""
    with jax.enable_x64(True):
        _tell_found()


def _tell_found() -> None:
    for bend in (BEND, 45.0):
        for harmonics, same in ((1, True), (2, True), (1, False)):
            parts, bends, period = fastest(bend, harmonics, same)
            told = jax.jit(partial(cycle, steps=2 * STEPS))(parts, bends, period)
            phases = jnp.linspace(0, 2 * jnp.pi, 1000)
            peak = float(jnp.abs(jax.vmap(partial(speeds, parts))(phases)).max())
            where = "same way" if same else "any way"
            _tell(f"{where}, to {bend:g} degrees, {harmonics} harmonics", told, float(period))
            grows = np.abs(np.linalg.eigvals(_after(parts, bends, period))).max()
            print(
                f"{'':34} peak {peak:.4f} m/s, first bends {np.degrees(bends).round(2).tolist()},"
            )
            print(f"{'':34} an error of shape is {grows:.2f} times as large a cycle later,")
            print(f"{'':34} parts {np.round(np.asarray(parts), 4).tolist()}")


def glides() -> None:
    """Print the fastest steady swims under the published peak: jets and shape that stay as they
    are, without a turn.

    At a shape r the jets u turn the chain and bend its joints by B(r) u. Where B is singular some
    jets do neither, and the chain glides.
    """
    with jax.enable_x64(True):
        for bend in (BEND, 45.0):
            _tell_glide(bend)


def _tell_glide(bend: float) -> None:
    axis = np.radians(np.linspace(-bend, bend, GRID))
    shapes = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    sizes = np.linalg.det(_responses(shapes)[:, 2:]).reshape(GRID, GRID)
    grid, found = shapes.reshape(GRID, GRID, 2), []
    for one, other in ((np.s_[:-1], np.s_[1:]), (np.s_[:, :-1], np.s_[:, 1:])):
        low, high = sizes[one], sizes[other]
        part = (low / (low - high))[..., None]
        at = grid[one] + part * (grid[other] - grid[one])
        found.append(at[(low * high < 0)])
    at = np.concatenate(found)[: len(shapes)]
    by = _responses(at)
    jets = np.linalg.svd(by[:, 2:])[2][:, -1]  # that B is nearest to undoing
    jets = PEAK * jets / np.abs(jets).max(axis=1, keepdims=True)
    ways = np.einsum("nij,nj->ni", by[:, :2], jets)
    best = np.linalg.norm(ways, axis=1).argmax()
    shape, jet, small = at[best], jets[best], 1e-5
    sides = shape + small * np.array([(1, 0), (-1, 0), (0, 1), (0, -1)])
    rates = _responses(sides)[:, 3:] @ jet
    slopes = np.stack([rates[0] - rates[1], rates[2] - rates[3]], axis=1) / (2 * small)
    print(
        f"glide, joints to {bend:g} degrees: {1e3 * np.linalg.norm(ways[best]):.1f} mm/s"
        f" with jets of {np.round(jet, 4).tolist()} m/s, joints at"
        f" {np.round(np.degrees(shape), 2).tolist()} degrees;"
        f" errors of shape grow by {np.linalg.eigvals(slopes).real.round(3).tolist()} each second"
    )


def _responses(shapes: np.ndarray) -> np.ndarray:
    """For each shape (rad): velocity of the middle, turning of the first link and of the joints,
    (5, 3) for 1 m/s of each jet."""
    padded = np.zeros((GRID**2, 2))
    padded[: len(shapes)] = shapes
    return np.asarray(_respond(jnp.asarray(padded)))[: len(shapes)]


@jax.jit
def _respond(shapes: Array) -> Array:
    robot = LandSalp.robot(jet=1.0, control_step=1e-9, substeps=1)

    def of(bends: Array, jets: Array) -> Array:
        units = robot.advance(robot.straight(3, bends), jets).units
        turning = units.angular_velocity
        return jnp.concatenate([units.velocity.mean(axis=0), turning[:1], jnp.diff(turning)])

    one = jax.vmap(of, in_axes=(None, 0), out_axes=1)
    return jax.vmap(one, in_axes=(0, None))(shapes, jnp.eye(3))


def _after(parts: Array, bends: Array, period: Array) -> np.ndarray:
    """What becomes of a small error of the joints in a cycle: the matrix that it is times."""
    by = jax.jit(jax.jacfwd(lambda b: cycle(parts, b, period).change + b))(bends)
    return np.asarray(by)


def fastest(bend: float, harmonics: int, same: bool, tries: int = 3) -> tuple[Array, Array, Array]:
    """Parts (m/s), first joint angles (rad) and period (s) of the fastest gait found.

    Its shape repeats itself and it does not turn; jets stay within the published peak and joints
    within `bend` (degrees); it goes the `same` way from the chain's axis as the published one, or
    any. Sequential quadratic programming from several starts.
    """
    shape = (1 + 2 * harmonics, 3)
    dice, best = np.random.default_rng(harmonics), None
    problem = _Problem(bend, shape, same)
    for number in range(tries):
        start = problem.start(dice, number)
        found = minimize(
            problem.cost, start, jac=True, method="SLSQP", constraints=problem.constraints,
            options={"maxiter": 200, "ftol": 1e-6},
        )  # fmt: skip
        worst = problem.violation(found.x)
        if worst < 1e-4 and (best is None or found.fun < best.fun):
            best = found
    if best is None:
        raise RuntimeError("no start led to a gait")
    return problem.gait(jnp.asarray(best.x))


class _Problem:
    """The search for a gait as numbers of order 1: parts in peaks, angles in bends, period."""

    def __init__(self, bend: float, shape: tuple[int, int], same: bool) -> None:
        self.bend, self.shape, self.same = np.radians(bend), shape, same
        self.number = shape[0] * shape[1]
        way = np.asarray(jax.jit(cycle)(jnp.asarray(PUBLISHED), jnp.zeros(2)).way)
        self.ahead = way / np.linalg.norm(way)
        self._cost = jax.jit(jax.value_and_grad(self._slowness))
        self._equal, self._equal_by = self._with_slope(self._closed)
        self._least, self._least_by = self._with_slope(self._room)
        self.constraints = [
            {"type": "eq", "fun": self._equal, "jac": self._equal_by},
            {"type": "ineq", "fun": self._least, "jac": self._least_by},
        ]

    def _with_slope(self, function: Any) -> tuple[Any, Any]:
        value, slope = jax.jit(function), jax.jit(jax.jacfwd(function))
        return lambda x: np.asarray(value(x)), lambda x: np.asarray(slope(x))

    def gait(self, x: Array) -> tuple[Array, Array, Array]:
        """Parts (m/s), first joint angles (rad) and period (s)."""
        parts = PEAK * x[: self.number].reshape(self.shape)
        return parts, self.bend * x[self.number : self.number + 2], PERIOD * jnp.exp(x[-1])

    def start(self, dice: Any, number: int) -> np.ndarray:
        """The published gait, as it is and then with chance added."""
        x = np.zeros(self.number + 3)
        x[:9] = PUBLISHED.ravel() / PEAK
        return x + (0.3 * dice.standard_normal(x.shape) if number else 0.0)

    def cost(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        """Minus the speed, and its slope."""
        value, slope = self._cost(x)
        return float(value), np.asarray(slope)

    def violation(self, x: np.ndarray) -> float:
        """How far the worst constraint is from being met."""
        return max(np.abs(self._equal(x)).max(), -self._least(x).min())

    def _told(self, x: Array) -> Cycle:
        return cycle(*self.gait(x), steps=96)

    def _slowness(self, x: Array) -> Array:
        """Minus the speed (cm/s)."""
        told = self._told(x)
        way = told.way @ self.ahead if self.same else told.length
        return -way / self.gait(x)[2] / 0.01

    def _closed(self, x: Array) -> Array:
        told = self._told(x)
        aside = (self.ahead[0] * told.way[1] - self.ahead[1] * told.way[0])[None] / 0.01
        return jnp.concatenate([told.change, told.turn[None], *([aside] if self.same else [])])

    def _room(self, x: Array) -> Array:
        """What is left of the joints' bend and of the jets' peak, and of 2 to 20 s for a cycle."""
        phases = jnp.linspace(0, 2 * jnp.pi, 48, endpoint=False)
        jets = jax.vmap(partial(speeds, self.gait(x)[0]))(phases).ravel() / PEAK
        bends = self._told(x).bends[::4].ravel() / self.bend
        slow, quick = jnp.log(20 / PERIOD) - x[-1], x[-1] - jnp.log(2 / PERIOD)
        return jnp.concatenate([1 - jets, 1 + jets, 1 - bends, 1 + bends, slow[None], quick[None]])
