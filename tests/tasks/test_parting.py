"""The tasks `dock`, `passage` and `gather`: how they begin, what they count, what is refused."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

from salpchain.cli.main import run
from salpchain.controllers.policy import Policy, PolicyCard
from salpchain.errors import InputError
from salpchain.networks.actor_critic import actor_critic
from salpchain.networks.config import ControlConfig
from salpchain.physics.docking import shut
from salpchain.tasks.features import observation_size
from salpchain.tasks.observations import observe
from salpchain.tasks.parting.config import WAYS, DockConfig, GatherConfig, PassageConfig
from salpchain.tasks.parting.course import Parting, is_whole
from salpchain.tasks.registry import make_task
from salpchain.world.obstacles import check_clear, make_obstacles
from salpchain.world.world import World

LENGTH, SLOTS = 6, 8
CONFIGS = {
    "dock": DockConfig(SLOTS, action="grip"),
    "gather": GatherConfig(SLOTS, action="grip"),
    **{f"passage {way}": PassageConfig(SLOTS, action="grip", opening=0.5, way=way) for way in WAYS},
}


@functools.cache
def begun(name: str):
    """The task, and the starts of twelve episodes."""
    env = make_task(CONFIGS[name])
    assert isinstance(env, Parting)
    return env, jax.jit(jax.vmap(lambda key: env.reset(key, LENGTH)))(jr.split(jr.key(4), 12))


def one(states, index=0):
    return jax.tree.map(lambda x: x[index], states)


SELDOM = ("passage two", "passage winding", "passage blocks", "passage tunnel")
EACH = [pytest.param(name, marks=[pytest.mark.slow] * (name in SELDOM)) for name in CONFIGS]


@pytest.mark.parametrize("name", EACH)
def test_an_episode_begins_at_rest_with_joints_closed_and_nothing_in_the_way(name):
    env, states = begun(name)
    for index in range(12):
        state = one(states, index)
        chain, world = state.chain, env.world_of(state)
        joined = np.asarray(chain.joined)
        ends = chain.links.position + 0.035 * jnp.stack(
            [jnp.cos(chain.links.angle), jnp.sin(chain.links.angle)], -1
        )
        off = np.linalg.norm(ends - chain.units.position[1:], axis=-1)
        assert off[joined].max() < 1e-5
        assert off[: LENGTH - 1][~joined[: LENGTH - 1]].min(initial=1.0) > 0.1
        place = np.asarray(chain.units.position)[:LENGTH]
        apart = np.linalg.norm(place[:, None] - place, axis=-1) + np.eye(LENGTH)
        assert apart.min() > 0.065
        if world.obstacles is not None:
            check_clear(chain, world.obstacles)
            at_target = eqx.tree_at(lambda c: c.units.position, chain, state.target)
            nothing = eqx.tree_at(lambda c: c.linked, at_target, jnp.zeros(SLOTS - 1, bool))
            check_clear(nothing, world.obstacles)


@pytest.mark.parametrize(("name", "pieces"), [("dock", 2), ("gather", 3), ("passage wall", 1)])
def test_pieces_are_those_that_the_task_says(name, pieces):
    _, states = begun(name)
    joined = np.asarray(states.chain.linked)[:, : LENGTH - 1]
    assert ((~joined).sum(axis=1) + 1 == pieces).all()
    assert bool(is_whole(one(states).chain)) == (pieces == 1)


def test_circles_round_the_two_chains_of_dock_are_apart_as_asked():
    _, states = begun("dock")
    place = np.asarray(states.chain.units.position)[:, :LENGTH]
    centres = place[:, :3].mean(axis=1) - place[:, 3:].mean(axis=1)
    np.testing.assert_allclose(np.linalg.norm(centres, axis=1), 1.0 + 3 * 0.07, atol=1e-4)


def test_a_chain_in_its_pose_that_is_not_one_has_not_reached_the_goal():
    env, states = begun("passage wall")
    state = one(states)
    x = jnp.linspace(0, 0.07 * (SLOTS - 1), SLOTS)
    target = jnp.stack([x, jnp.zeros(SLOTS)], 1) + jnp.array([1.0, 0.0])
    along = eqx.tree_at(
        lambda c: (c.units.position, c.units.angle, c.links.position, c.links.angle, c.rest_angle),
        state.chain,
        (
            target,
            jnp.zeros(SLOTS),
            (target[1:] + target[:-1]) / 2,
            jnp.zeros(SLOTS - 1),
            jnp.zeros((SLOTS - 1, 2)),
        ),
    )
    there = eqx.tree_at(lambda s: (s.chain, s.target), state, (along, target))
    step = jax.jit(env.step)
    assert bool(step(there, jnp.zeros((SLOTS, 2))).goal)
    let_go = jnp.zeros((SLOTS, 2)).at[2, 1].set(-1.0)
    cut = step(there, let_go)
    assert not bool(cut.chain.linked[2]) and not bool(cut.goal)
    again = step(cut, jnp.zeros((SLOTS, 2)))
    assert bool(again.chain.linked[2])
    assert bool(again.goal) == bool(shut(again.chain)[: LENGTH - 1].all())


def test_dock_must_be_held_for_five_seconds():
    env, states = begun("dock")
    state = one(states)
    chain = one(begun("passage wall")[1]).chain
    there = eqx.tree_at(lambda s: (s.chain, s.target), state, (chain, chain.units.position))
    step, still = jax.jit(env.step), jnp.zeros((SLOTS, 2))
    goals = []
    for _ in range(51):
        there = step(there, still)
        goals.append(bool(there.goal))
    assert goals.index(True) == 49


def test_policies_that_cannot_let_go_play_every_task():
    for name in ("dock", "passage", "gather"):
        env = make_task(CONFIGS_THRUST[name])
        state = jax.jit(env.reset)(jr.key(1))
        after = jax.jit(env.step)(state, jnp.zeros((6, 1)))
        assert after.chain.joined.tolist() == state.chain.joined.tolist()


CONFIGS_THRUST = {
    "dock": DockConfig(6), "passage": PassageConfig(6), "gather": GatherConfig(6)
}  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "bad", "said"),
    [
        (PassageConfig, {"opening": 0.0}, "opening must be a number, above 0 to 5, got 0.0"),
        (PassageConfig, {"walls": (1.0, 2.0, 3.0)}, "walls must be x,y,x,y of the ends of each"),
        (PassageConfig, {"walls": (1.0,) * 4}, "walls must have their two ends apart, wall 0 has"),
        (PassageConfig, {"walls": (1.0, 0.0, 2.0, 0.0) * 17}, "walls must be 16 or fewer, got 17"),
        (PassageConfig, {"way": "hole"}, "unknown way 'hole': choose one of wall, two"),
        (DockConfig, {"apart": 0.0}, "apart must be a number, 0.1 to 10 m, got 0.0"),
        (DockConfig, {"capture": 0.5}, "capture must be a number, 0.001 to 0.2, got 0.5"),
        (GatherConfig, {"group": 3}, "group must be 1 or 2 units, got 3"),
    ],
)
def test_what_cannot_be_is_one_line(kind, bad, said):
    with pytest.raises(InputError, match=said.replace("(", r"\(")):
        kind(**bad)


def test_an_opening_that_no_unit_fits_is_refused_before_anything_runs(tmp_path, capsys):
    asked = ["evaluate", "caravan", "--task", "passage", "--set", "task.opening=0.05"]
    assert run([*asked, "--lengths", "8", "--trials", "1", "--out", str(tmp_path / "no")]) == 2
    said = capsys.readouterr().err
    assert "opening 0.05 of 8 units is 2.8 cm: no unit fits" in said and said.count("\n") == 1


@pytest.mark.parametrize(
    ("wall", "what"),
    [
        ("-1,-5,-1,5", "start"),
        ("-0.9,0.1,-0.8,0.1", "start"),
        ("-3,0.6,-0.2,-0.6", "start"),
        ("1,0,1.5,0", "arrive"),
        ("0.2,0.59,2,0.59", "arrive"),
    ],
)
def test_a_wall_across_start_or_target_is_refused_before_anything_runs(
    wall, what, tmp_path, capsys
):
    asked = ["evaluate", "caravan", "--task", "passage", "--set", f"task.walls={wall}"]
    assert run([*asked, "--lengths", "8", "--trials", "1", "--out", str(tmp_path / "no")]) == 2
    said = capsys.readouterr().err
    assert f"walls must be clear of where chains of 8 units {what}, x from" in said
    assert said.count("\n") == 1 and not (tmp_path / "no").exists()


@pytest.mark.parametrize(
    "wall", [(-1.0, 0.7, -0.5, 0.7), (-0.3, -9.0, -0.3, 9.0), (0.0, -1.0, 0.0, 1.0)]
)
def test_walls_of_ones_own_stand_beside_those_of_the_passage(wall):
    config = PassageConfig(6, opening=0.5, walls=wall)
    config.check_possible(6)
    env = make_task(config)
    obstacles = env.world_of(jax.jit(env.reset)(jr.key(3))).obstacles
    assert obstacles is not None
    assert obstacles.walls.present.tolist() == [True] * 3
    np.testing.assert_allclose(obstacles.walls.ends[2].ravel(), wall)


def test_what_begins_across_a_wall_of_the_passage_is_refused():
    env = make_task(PassageConfig(6, opening=0.5))
    state = env.reset(jr.key(3))
    across = eqx.tree_at(
        lambda c: (c.units.position, c.links.position),
        state.chain,
        (state.chain.units.position + jnp.array([0.0, 1.0]) - state.chain.units.position[2],
         state.chain.links.position + jnp.array([0.0, 1.0]) - state.chain.units.position[2]),
    )  # fmt: skip
    with pytest.raises(InputError, match="wall 1 covers unit 2 at the start"):
        env.start(across, state.target, jr.key(0))
    with pytest.raises(InputError, match="a wall covers the target"):
        env.start(state.chain, across.units.position, jr.key(0))


def test_walls_of_ones_own_are_refused_in_a_passage():
    wall = make_obstacles(walls=[((0.0, 0.0), (1.0, 0.0), 0.04)])
    with pytest.raises(InputError, match="passage has walls of its own"):
        make_task(PassageConfig(6), World(obstacles=wall))


def test_each_piece_observes_as_a_chain_of_its_own():
    _, states = begun("gather")
    state = one(states)
    chain = eqx.tree_at(lambda c: c.units.velocity, state.chain, jr.normal(jr.key(3), (SLOTS, 2)))
    seen = observe("body", chain, state.target, state.force)

    def alone(x):
        return x[2:4] if x.ndim and x.shape[0] == SLOTS else x[2:3] if x.ndim else x

    pair = jax.tree.map(alone, eqx.tree_at(lambda c: c.docking, chain, None))
    mine = observe("body", pair, state.target[2:4], state.force[2:4])
    np.testing.assert_allclose(seen[2:4], mine, atol=1e-5)


@pytest.mark.parametrize("graph", ["mixed", "near"])
def test_what_one_piece_does_changes_no_action_of_another(graph):
    _, states = begun("gather")
    state = one(states)
    config = ControlConfig(graph=graph)
    network = actor_critic(jr.key(0), config, observation_size("body"), 1, SLOTS)
    policy = Policy(network, PolicyCard(control=config, length=SLOTS))
    moved = eqx.tree_at(
        lambda c: c.units.position, state.chain, state.chain.units.position.at[:2].add(0.3)
    )
    other = observe("body", moved, state.target, state.force)
    one_action, two = policy.act(state), policy.act(eqx.tree_at(lambda s: s.obs, state, other))
    np.testing.assert_allclose(one_action[2:LENGTH], two[2:LENGTH], atol=1e-6)
    assert float(jnp.abs(one_action[:2] - two[:2]).max()) > 1e-6
