"""What a task of a user's own gives, checked when it is traced; free once compiled."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
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
    return Judgement(dict(terms), jnp.asarray(ended, bool))


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
