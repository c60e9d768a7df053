"""Sizes of controllers."""

import equinox as eqx
import jax
import jax.random as jr

from salpchain.networks.actor_critic import actor_critic
from salpchain.networks.config import ControlConfig
from salpchain.tasks.config import ACTION_SIZES


def num_parameters(model: str, inputs: int, length: int) -> int:
    """Learnable numbers of a model as the paper counts them: action `pair`, a log-std for each.

    Args:
        model: name of the model.
        inputs: numbers that each unit observes.
        length: units in training.
    """
    config = ControlConfig(model=model, shared_log_std=False)
    actions = ACTION_SIZES["pair"]
    shapes = eqx.filter_eval_shape(actor_critic, jr.key(0), config, inputs, actions, length)
    return sum(leaf.size for leaf in jax.tree.leaves(shapes))
