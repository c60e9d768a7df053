"""Which lengths a run trains on now: all of its mix, or a curriculum that grows."""

from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import jax.random as jr
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from salpchain.tasks.task import Task
from salpchain.training.config import TrainConfig

WINDOW = 200.0  # latest episodes of each length over which its success is judged (chosen)
ENOUGH = 100.0  # episodes of a length before it is judged (chosen)


class Curriculum(eqx.Module):
    """How far the curriculum has come, with what the latest episodes of each length were."""

    stage: Int[Array, ""]  # index of the longest length in play
    episodes: Float[Array, " length"]  # at most `WINDOW`, the older ones fading
    goals: Float[Array, " length"]  # of these, reached
    # Share of their world's settings that episodes are spared besides; None where they never were.
    ease: Float[Array, ""] | None = None


STEP = 0.05  # by which the ease falls (chosen)


def new_curriculum(config: TrainConfig) -> Curriculum:
    """The curriculum before its first episode: the shortest length alone where it is to grow."""
    last = len(config.lengths) - 1
    none = jnp.zeros(last + 1)
    ease = jnp.ones(()) if config.mix.roughen else None
    return Curriculum(jnp.int32(0 if config.mix.grow else last), none, none, ease)


def eased(env: Task, curriculum: Curriculum) -> Task:
    """The task in worlds as rough as the curriculum has come to."""
    if curriculum.ease is None:
        return env
    return replace(env, world=replace(env.world, ease=curriculum.ease))


def draw_length(config: TrainConfig, curriculum: Curriculum, key: PRNGKeyArray) -> Int[Array, ""]:
    """A length (units) for a new episode, of those in play, each as often as its weight says."""
    lengths = jnp.array(config.lengths)
    if len(config.lengths) == 1:
        return lengths[0]
    weights = jnp.array(config.mix.weights or (1.0,) * len(config.lengths))
    chances = jnp.where(_in_play(curriculum), jnp.log(weights), -jnp.inf)
    return lengths[jr.categorical(key, chances)]


def advance(
    config: TrainConfig,
    curriculum: Curriculum,
    episodes: Float[Array, " length"],
    goals: Float[Array, " length"],
) -> Curriculum:
    """The curriculum after these more episodes; one length longer if all in play are solved.

    The episodes must be those of whole start cohorts (`cohorts.count`): short episodes, which end
    first, are mostly successes, and would let a length join too soon.
    """
    counted, reached = curriculum.episodes + episodes, curriculum.goals + goals
    fade = jnp.minimum(1.0, WINDOW / jnp.maximum(counted, 1.0))
    counted, reached = counted * fade, reached * fade
    solved = (counted >= ENOUGH) & (reached >= config.mix.grow * counted)
    joins = (solved | ~_in_play(curriculum)).all()
    grown = jnp.minimum(curriculum.stage + joins, len(config.lengths) - 1)
    ease = curriculum.ease
    if ease is not None:
        many = counted.sum() >= ENOUGH * len(config.lengths)
        rougher = many & (reached.sum() >= config.mix.roughen * counted.sum())
        ease = jnp.where(rougher, jnp.maximum(ease - STEP, 0.0), ease)
        counted, reached = (jnp.where(rougher, 0.0, x) for x in (counted, reached))
    return Curriculum(grown, counted, reached, ease)


def _in_play(curriculum: Curriculum) -> Bool[Array, " length"]:
    return jnp.arange(curriculum.episodes.shape[0]) <= curriculum.stage
