from dataclasses import replace

import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

from salpchain.controllers.by_jet import by_jet
from salpchain.controllers.observing import observing
from salpchain.controllers.policy import PolicyCard, as_policy
from salpchain.controllers.storage import load, save_policy
from salpchain.errors import InputError
from salpchain.interop.export import export
from salpchain.networks.actor_critic import actor_critic
from salpchain.networks.config import ControlConfig
from salpchain.tasks.features import layout, observation_size
from salpchain.tasks.reach.task import SCLD
from salpchain.training.config import TrainConfig
from salpchain.training.start import policy_to_start, with_weights
from salpchain.training.trainer import resume, train
from salpchain.world.config import ThrusterConfig, WorldConfig
from salpchain.world.world import World
from tests.training.small import small

ONE_WAY = WorldConfig(thrusters=ThrusterConfig(one_sided=True))


def policy(seed, observation="sea", **card):
    size = observation_size(observation)
    network = actor_critic(jr.key(seed), ControlConfig(), size, 1, 8)
    return as_policy(network, PolicyCard(name=f"no-{seed}", observation=observation, **card))


TWO, ONE = policy(0), policy(1, lengths=(4, 8), steps=5)
BOTH = by_jet(TWO, ONE, "both")


def swimming(world, units=5):
    env = SCLD(TWO.card.task(units), world=world)
    return jax.jit(env.reset)(jr.key(3))


@pytest.mark.parametrize(("world", "own"), [(World(), TWO), (ONE_WAY, ONE)])
def test_a_chain_is_steered_by_the_policy_of_its_jets(world, own):
    state = swimming(world)
    action = BOTH.act(state)
    np.testing.assert_allclose(action, own.act(state), atol=1e-7)
    assert np.abs(TWO.act(state) - ONE.act(state)).max() > 1e-4
    chain = state.chain
    value = BOTH.network(state.obs, chain.present, chain.joined)[1]
    assert float(value) == pytest.approx(
        float(own.network(state.obs, chain.present, chain.joined)[1])
    )


def test_in_a_chain_of_both_kinds_every_unit_goes_by_its_own_jet():
    state = swimming(World())
    names = [field.name for field in layout("sea")]
    reverse = names.index("gain of the own thruster backwards")
    some = jnp.array([False, True, False, False, True])
    mixed = replace(state, obs=state.obs.at[:, reverse].set(jnp.where(some, 0.0, 1.0)))
    action, two, one = (np.asarray(each.act(mixed)) for each in (BOTH, TWO, ONE))
    np.testing.assert_allclose(action, np.where(some[:, None], one, two), atol=1e-7)


def test_a_unit_that_tells_nothing_or_is_dead_counts_as_one_whose_jet_pushes_both_ways():
    state = swimming(ONE_WAY)
    silent = replace(state, obs=state.obs.at[2].set(0.0))
    np.testing.assert_allclose(BOTH.act(silent)[2], TWO.act(silent)[2], atol=1e-7)
    np.testing.assert_allclose(BOTH.act(silent)[1], ONE.act(silent)[1], atol=1e-7)


def test_units_of_one_network_may_observe_no_more_than_their_neighbours():
    plain = policy(4, "proximity")
    both, state = by_jet(plain, ONE, "both"), swimming(World())
    seen = replace(state, obs=state.obs[:, : observation_size("proximity")])
    np.testing.assert_allclose(both.act(state), plain.act(seen), atol=1e-7)
    assert both.card.observation == "sea"


def test_a_network_for_a_whole_chain_observes_nothing_more():
    """Its inputs are those of all units in a row: more of them would come in between."""
    network = actor_critic(jr.key(0), ControlConfig("mlp"), observation_size("proximity"), 1, 3)
    card = PolicyCard(control=ControlConfig("mlp"), observation="proximity", length=3)
    with pytest.raises(InputError, match="an mlp observes proximity and nothing else"):
        observing(as_policy(network, card), "sea")


def test_it_is_kept_as_one_file_and_its_card_tells_of_both(tmp_path):
    save_policy(BOTH, tmp_path / "both.safetensors")
    again = load(tmp_path / "both.safetensors")
    state = swimming(ONE_WAY)
    np.testing.assert_array_equal(again.act(state), BOTH.act(state))
    assert again.card == BOTH.card
    assert (BOTH.card.lengths, BOTH.card.steps, BOTH.card.control.by_jet) == ((4, 8), 5, True)


@pytest.mark.slow
def test_a_run_begins_with_both_from_one_or_from_both_and_can_be_resumed(tmp_path):
    save_policy(TWO, tmp_path / "two.safetensors")
    base = small(2)
    config = replace(
        base,
        task=replace(base.task, observation="sea"),
        control=ControlConfig(by_jet=True),
        world=ONE_WAY,
        start=str(tmp_path / "two.safetensors"),
    )
    fresh = actor_critic(jr.key(5), config.control, observation_size("sea"), 1, 3)
    begun, state = with_weights(fresh, policy_to_start(config)), swimming(ONE_WAY, 3)
    chain = state.chain
    action = begun.act(state.obs, chain.present, chain.joined)
    np.testing.assert_allclose(action, TWO.act(state), atol=1e-7)

    def stop(_, step):
        raise InterruptedError

    with pytest.raises(InterruptedError):
        train(config, tmp_path / "run", on_iteration=stop)
    resume(tmp_path / "run")
    learned = load(tmp_path / "run").network
    moved = [
        max(np.abs(a - b).max() for a, b in zip(*map(jax.tree.leaves, pair), strict=True))
        for pair in (
            (learned.both_ways.trunk, TWO.network.trunk),
            (learned.one_way.trunk, TWO.network.trunk),
        )
    ]
    assert moved[0] == 0.0  # no jet of these worlds pushes both ways
    assert moved[1] > 0.0
    again = replace(config, start=str(tmp_path / "run"))
    begun = with_weights(fresh, policy_to_start(again))
    np.testing.assert_array_equal(
        begun.act(state.obs, chain.present, chain.joined), load(tmp_path / "run").act(state)
    )
    with pytest.raises(InputError, match="has another control"):
        policy_to_start(replace(again, control=ControlConfig()))


def test_what_does_not_go_together_is_refused(tmp_path):
    with pytest.raises(InputError, match="such as jets or sea, got body"):
        TrainConfig(control=ControlConfig(by_jet=True))
    with pytest.raises(InputError, match="remember nothing, got memory"):
        ControlConfig(by_jet=True, memory=True)
    with pytest.raises(InputError, match="got model mlp"):
        ControlConfig("mlp", by_jet=True)
    with pytest.raises(InputError, match="begins as jets does, such as jets or sea, got proximity"):
        by_jet(policy(0, "proximity"), policy(1, "proximity"), "blind")
    with pytest.raises(InputError, match=r"no-0 observes sea, with which .* does not begin"):
        by_jet(TWO, policy(1, "jets"), "two")
    with pytest.raises(
        InputError, match="both policies must have the same action: no-0 has thrust"
    ):
        other = actor_critic(jr.key(1), ControlConfig(), observation_size("sea"), 2, 8)
        by_jet(TWO, as_policy(other, replace(ONE.card, action="pair")), "two")
    with pytest.raises(InputError, match="both has two networks already"):
        by_jet(BOTH, BOTH, "four")
    with pytest.raises(InputError, match="both has two, by what jet a unit has"):
        export(BOTH, tmp_path / "both.onnx", "onnx")
