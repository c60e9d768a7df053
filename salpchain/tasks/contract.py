"""What a task of a user's own gives, checked when it is traced; free once compiled."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from salpchain.errors import InputError
from salpchain.given import told
from salpchain.physics.state import Chain
from salpchain.tasks.checks import check_chain, checked_vectors
from salpchain.tasks.state import Judgement, Start, State

if TYPE_CHECKING:
    from salpchain.tasks.task import Task


def checked_start(task: "Task", start: Any) -> Start:
    """What the task's `begin` gave.

    Raises:
        InputError: no start, or a chain or a target of other slots; the task is named.
    """
    begin = f"{type(task).__name__}.begin"
    if not isinstance(start, tuple) or len(start) not in (2, 3) or not isinstance(start[0], Chain):
        raise InputError(f"{begin} must give a salpchain Start(chain, target), got {told(start)}")
    chain, target, *plan = start
    with _named(begin):
        check_chain(chain, task.config.length)
        target = checked_vectors("the target", target, chain.units.position)
    return Start(chain, target, *plan)


def checked_move(task: "Task", moved: Any, state: State) -> tuple[Float[Array, "unit 2"], Any]:
    """What the task's `move` gave for this state.

    Raises:
        InputError: no target with a plan, a target of other slots, or another kind of plan.
    """
    move = f"{type(task).__name__}.move"
    if not isinstance(moved, tuple) or len(moved) != 2:
        raise InputError(f"{move} must give a target and a plan, got {told(moved)}")
    with _named(move):
        target = checked_vectors("the target", moved[0], state.target)
    before, after = _form(state.plan), _form(moved[1])
    if before != after:
        raise InputError(f"{move} must give a plan like that of begin, {before}, got {after}")
    return target, moved[1]


def checked_judgement(task: "Task", judged: Any) -> Judgement:
    """What the task's `judge` gave.

    Raises:
        InputError: no judgement, other terms than have weights, or one that is no single number.
    """
    judge, wanted = f"{type(task).__name__}.judge", list(task.weights)
    if not isinstance(judged, tuple) or len(judged) != 2 or not isinstance(judged[0], Mapping):
        raise InputError(f"{judge} must give a Judgement(terms, ended), got {told(judged)}")
    terms, ended = judged
    if set(terms) != set(wanted):
        raise InputError(
            f"{judge} must give the terms that have weights, {', '.join(wanted) or 'none'},"
            f" got {', '.join(map(str, terms)) or 'none'}"
        )
    for name, value in {**terms, "ended": ended}.items():
        if jnp.shape(value) != ():
            raise InputError(
                f"{judge} must give one number for {name}, got shape {jnp.shape(value)}"
            )
    numbers = {name: jnp.asarray(value, float) for name, value in terms.items()}
    return Judgement(numbers, jnp.asarray(ended, bool))


def check_contract(task: "Task") -> None:
    """Raise InputError unless all that the task gives is what it should; nothing is computed.

    Raises:
        InputError: a method that is missing, that raises, or that gives another kind of thing; the
            message names it, and says what was expected.
    """
    from salpchain.tasks.task import Task

    kind = type(task)
    for method, what in NEEDED.items():
        if getattr(kind, method) is getattr(Task, method):
            raise InputError(f"{kind.__name__} has no {method}, {what}: docs/recipes/task.md")
    key = jax.eval_shape(lambda: jax.random.key(0))
    action = jax.ShapeDtypeStruct((task.config.length, task.action_size), jnp.result_type(float))
    state = _traced(task, "reset", key)
    _check_alike(task, "reset", state, _expected(task, state))
    after = _traced(task, "step", state, action)
    _check_alike(task, "step", after, state)
    credit, length = _traced(task, "credit", state, after), task.config.length
    if jnp.shape(credit) != (length,):
        raise InputError(
            f"{kind.__name__}.credit must give a number for each unit, of shape ({length},), got"
            f" {told(credit)}"
        )
    _check_measures(task, _traced(task, "gauge", after))


NEEDED = {
    "weights": "how much each term of the reward counts",
    "begin": "how an episode begins",
    "judge": "what a step was worth",
}


def _traced(task: "Task", method: str, *given: Any) -> Any:
    """What a method of the task gives, as shapes.

    Raises:
        InputError: what it raises, with its name.
    """
    try:
        return jax.eval_shape(getattr(task, method), *given)
    except InputError:
        raise
    except Exception as error:
        raise InputError(f"{type(task).__name__}.{method} fails: {_one_line(error)}") from error


def _one_line(error: Exception) -> str:
    said = " ".join(str(error).split())
    return f"{type(error).__name__}: {said[:LONGEST]}{'...' if len(said) > LONGEST else ''}"


LONGEST = 200  # characters of another's message (chosen)


def _expected(task: "Task", state: Any) -> Any:
    """A state of this task as it should be, where its shapes are known from the settings."""
    if not isinstance(state, State):
        raise InputError(f"{type(task).__name__}.reset must give a State, got {told(state)}")
    length, float_ = task.config.length, jnp.result_type(float)
    seen = jax.ShapeDtypeStruct((length, task.observation_size), float_)
    one, points = (jax.ShapeDtypeStruct(shape, float_) for shape in ((), (length, 2)))
    return eqx.tree_at(lambda s: (s.obs, s.target, s.reward), state, (seen, points, one))


def _check_alike(task: "Task", method: str, given: Any, wanted: State) -> None:
    """Raise InputError unless a state has the shapes and types of another."""
    named = f"{type(task).__name__}.{method}"
    if not isinstance(given, State):
        raise InputError(f"{named} must give a State, got {told(given)}")
    for (path, one), (_, other) in zip(_leaves(given), _leaves(wanted), strict=False):
        mine, right = (f"{x.dtype}{list(x.shape)}" for x in (one, other))
        if mine != right:
            raise InputError(f"{named} must give {path[1:]} as {right}, got {mine}")
    if jax.tree.structure(given) != jax.tree.structure(wanted):
        raise InputError(f"{named} must give a State with the same parts as reset's")


def _leaves(state: State) -> list[tuple[str, Any]]:
    return [
        (jax.tree_util.keystr(path), leaf)
        for path, leaf in jax.tree_util.tree_flatten_with_path(state)[0]
        if not jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key)
    ]


def _check_measures(task: "Task", gauged: Any) -> None:
    """Raise InputError unless `gauge` gives numbers by name, and `measure` numbers of those."""
    gauge, measure = (f"{type(task).__name__}.{name}" for name in ("gauge", "measure"))
    if not isinstance(gauged, Mapping):
        raise InputError(f"{gauge} must give a dict of numbers by name, got {told(gauged)}")
    for name, value in gauged.items():
        if jnp.shape(value) != ():
            raise InputError(
                f"{gauge} must give one number for {name}, got shape {jnp.shape(value)}"
            )
    series = {name: np.zeros(3, np.float32) for name in gauged}
    try:
        found = task.measure(series) if series else {}
    except Exception as error:
        raise InputError(f"{measure} fails: {_one_line(error)}") from error
    if not isinstance(found, Mapping) or not all(np.shape(x) == () for x in found.values()):
        raise InputError(f"{measure} must give a dict of numbers by name, got {told(found)}")


@contextmanager
def _named(method: str) -> Iterator[None]:
    """Lets an error name the method of the task that is at fault."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{method}: {error}") from None


def _form(plan: Any) -> str:
    """The structure of a plan, with the shapes and types of its arrays."""
    shapes = jax.tree.map(lambda x: f"{jnp.result_type(x)}{list(jnp.shape(x))}", plan)
    return "nothing" if plan is None else " ".join(str(shapes).replace("'", "").split())
