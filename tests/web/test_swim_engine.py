"""The swim page's engine and policy against this package's: same starts, thrusts, files."""

import base64
import json
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

import salpchain
from salpchain.controllers.storage import save_policy
from salpchain.interop.export import export
from salpchain.physics.chain import step
from salpchain.physics.state import Physics, at_rest
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.features import OBSERVATIONS
from salpchain.tasks.observations import Around, observe
from salpchain.tasks.reach.frechet import frechet_distance
from salpchain.tasks.reach.task import SCLD
from salpchain.web import drawing, swim_page, swimmer
from salpchain.world.current import Uniform, carried
from salpchain.world.obstacles import make_obstacles
from salpchain.world.thrusters import Thrusters
from salpchain.world.world import World
from tests.web.engine import as_json, ask, columns

STEPS = 100
RUN = """(() => {
  const chain = chainOf(DATA.chain), found = [];
  let touching = 0, blocked = 0;
  DATA.thrust.forEach((row) => {
    Physics.step(chain, row, { contact: DATA.contact, current: DATA.current,
      solids: [...DATA.walls.map(Physics.wall), ...DATA.posts.map(Physics.post)] });
    touching += chain.touching; blocked += chain.blocked;
    found.push(rowsOf(chain.units));
  });
  return { found, touching, blocked };
})()"""


def start(length, seed, **settings):
    config = TaskConfig(length=length, **settings)
    return SCLD(config).reset(jr.key(seed))


def swum(chain, thrust, double=True, **around):
    """Units (step, unit, 6) of the Python engine under thrusts (step, unit); touches counted.

    In double precision, as the page has it: loaded joints chatter, which amplifies the rounding of
    single precision to some tenths of a millimetre within ten control steps.
    """
    with jax.enable_x64(double):
        kind = jnp.float64 if double else jnp.float32
        floats = eqx.filter(chain, eqx.is_inexact_array)
        rest = eqx.filter(chain, eqx.is_inexact_array, inverse=True)
        cast = jax.tree.map(lambda x: jnp.asarray(np.asarray(x), kind), floats)
        return _swum(eqx.combine(cast, rest), jnp.asarray(thrust, kind), **around)


def _swum(chain, thrust, contact=True, walls=(), posts=(), current=(0.0, 0.0)):
    flow, physics = Uniform(jnp.asarray(current)), Physics()
    obstacles = None
    if walls or posts:
        obstacles = make_obstacles(
            [((ax, ay), (bx, by), width) for ax, ay, bx, by, width in walls],
            [((x, y), radius) for x, y, radius in posts],
        )

    @jax.jit
    def advance(chain, row):
        drifting = carried(chain, flow, physics)
        return step(drifting, row, physics, contact=contact, obstacles=obstacles)

    found, touching = [], 0
    for row in thrust:
        chain = advance(chain, row)
        touching += bool(chain.touching)
        found.append(columns(chain.units))
    return np.stack(found), touching


def page_swum(chain, thrust, contact=True, walls=(), posts=(), current=(0.0, 0.0)):
    data = {"chain": as_json(chain), "thrust": thrust.tolist(), "contact": contact}
    data |= {"walls": walls, "posts": posts, "current": list(current)}
    answer = ask(RUN, data)
    return np.array(answer["found"]), answer["touching"], answer["blocked"]


def thrusts(length, seed, hold=10):
    """Random thrusts, held a second each."""
    dice = np.random.default_rng(seed)
    return np.repeat(dice.uniform(-1, 1, (STEPS // hold, length)), hold, axis=0)


def apart(one, other):
    return np.linalg.norm(one[..., :2] - other[..., :2], axis=-1).max(axis=-1)


@pytest.mark.parametrize("length", [2, 8, 32])
def test_without_contact_it_swims_as_the_python_engine_does(length):
    """To the rounding of a double at first; then chattering joints tell even that apart."""
    begun = [(start(length, seed).chain, thrusts(length, seed)) for seed in range(4)]
    away = []
    for chain, thrust in begun:
        ours, _ = swum(chain, thrust, contact=False)
        pages, touching, _ = page_swum(chain, thrust, contact=False)
        away.append(apart(ours, pages))
        assert apart(ours[-1], columns(chain.units)) > 0.02 and touching == 0  # it did swim
    away = np.array(away)
    print(f"{length} units after 1, 5, 10, 100: {away[:, [0, 4, 9, 99]]}")
    assert away[:, 0].max() < 1e-11 and away[:, 4].max() < 1e-5 and away[:, 99].max() < 1e-3


def test_in_single_precision_the_engine_is_as_near_to_the_page_as_to_itself():
    chain, thrust = start(8, 1).chain, thrusts(8, 2)
    single, _ = swum(chain, thrust, double=False, contact=False)
    double, _ = swum(chain, thrust, contact=False)
    pages, _, _ = page_swum(chain, thrust, contact=False)
    away, own = apart(single, pages), apart(single, double)
    print(f"single: {away[9]:.1e} m after 10 steps, {away[-1]:.1e} after 100; itself {own[9]:.1e}")
    assert away[-1] < 1e-3 and away[9] < 2 * own[9]


def folded_in_two(arm):
    """Two arms side by side, 14 cm apart, whose units push towards each other."""
    along = 0.07 * np.arange(arm)
    corner = [[along[-1], 0.07]]
    lower, upper = np.stack([along, 0 * along], 1), np.stack([along[::-1], 0 * along + 0.14], 1)
    angle = np.concatenate([np.zeros(arm), [np.pi / 2], np.full(arm, np.pi)])
    place = np.concatenate([lower, corner, upper])
    return at_rest(jnp.asarray(place, jnp.float32), jnp.asarray(angle, jnp.float32))


@pytest.mark.parametrize("strength", [0.1, 0.4])
def test_with_contact_it_stays_within_a_centimetre(strength):
    chain = folded_in_two(7)
    thrust = strength * np.ones((STEPS, 15)) * np.linspace(1, 0.5, 15)
    ours, touched = swum(chain, thrust)
    pages, touching, _ = page_swum(chain, thrust)
    print(f"{strength} N: {touched} steps in touch, {apart(ours, pages)[-1]:.1e} m after 100")
    assert touched > 20 and abs(touching - touched) <= 5
    assert apart(ours, pages)[-1] < 1e-2, apart(ours, pages)[::10]


def test_walls_posts_and_a_current_push_it_as_in_python():
    chain = start(8, 6).chain
    middle = columns(chain.units)[:, :2].mean(axis=0)
    heading = np.array([-np.sin(chain.units.angle[0]), np.cos(chain.units.angle[0])])
    along = np.array([heading[1], -heading[0]])
    a, b = middle + 0.12 * heading - 0.2 * along, middle + 0.12 * heading + 0.2 * along
    post = middle + 0.15 * heading + 0.3 * along
    around = {"walls": [[*a.tolist(), *b.tolist(), 0.04]], "posts": [[*post.tolist(), 0.05]]}
    thrust = np.ones((STEPS, 8))
    ours, _ = swum(chain, thrust, current=(0.02, -0.01), **around)
    pages, _, blocked = page_swum(chain, thrust, current=(0.02, -0.01), **around)
    away = apart(ours, pages)
    print(f"among walls: {away[4]:.1e} m after 5, {away[-1]:.1e} m after 100, blocked {blocked}")
    assert blocked > 20
    assert away[4] < 1e-9 and away[-1] < 1e-2


# --- observations and policies ------------------------------------------------------------------


def state(length, seed):
    """A chain on its way: its state, its last thrusts, a current and gains."""
    begun = start(length, seed, folded=1.0)
    dice = np.random.default_rng(seed)
    chain = begun.chain
    for _ in range(5):
        chain = step(chain, jnp.asarray(dice.uniform(-1, 1, length), jnp.float32))
    thrust = dice.uniform(-1, 1, length).astype(np.float32)
    return chain, begun.target, thrust, dice.uniform(0, 1, length).astype(np.float32)


def told(chain, target, thrust, gain, current):
    return {
        "chain": as_json(chain), "target": np.asarray(target, float).tolist(),
        "thrust": thrust.tolist(), "gain": gain.tolist(), "current": list(current),
    }  # fmt: skip


OBSERVE = """(() => {
  const file = (observation) => ({ observation });
  return DATA.names.map((name) => {
    const message = refusal(() => Policy.observer(name));
    return message || Array.from(Policy.observe(Policy.observer(name), viewOf(DATA.state)));
  });
})()"""


@pytest.mark.parametrize("length", [2, 9])
def test_units_see_on_the_page_what_they_see_here(length):
    chain, target, thrust, gain = state(length, 7)
    current, names = (0.03, -0.02), sorted({*OBSERVATIONS, "jets*3"})
    force = jnp.asarray(thrust)[:, None] * chain.units.heading
    world = World(current=Uniform(jnp.asarray(current)), thrusters=Thrusters(jnp.asarray(gain)))
    seen = ask(OBSERVE, {"names": names, "state": told(chain, target, thrust, gain, current)})
    refused = {name for name, numbers in zip(names, seen, strict=True) if isinstance(numbers, str)}
    assert refused == {"around"}  # it sees surfaces, which the page does not work out
    for name, numbers in zip(names, seen, strict=True):
        if name not in refused:
            ours = np.asarray(observe(name, chain, target, force, Around(world, 0)))
            np.testing.assert_allclose(np.reshape(numbers, ours.shape), ours, atol=3e-5)


ACT = """(() => {
  const policy = Policy.fromFile(bytesOf(DATA.file)), view = viewOf(DATA.state);
  return Array.from(Policy.actions(policy, Policy.observe(policy.observation, view), view.n));
})()"""


def page_actions(file, chain, target, thrust):
    gain = np.ones(len(thrust), np.float32)
    state = told(chain, target, thrust, gain, (0, 0))
    return np.array(ask(ACT, {"file": base64.b64encode(file).decode(), "state": state}))


@pytest.mark.parametrize("name", ["any-length", "paper-gcn-8"])
@pytest.mark.parametrize("length", [2, 13])
def test_the_same_policy_acts_the_same(name, length, tmp_path):
    policy = salpchain.load(name)
    chain, target, thrust, _ = state(length, 8)
    begun = SCLD(policy.card.task(length)).start(chain, target, jr.key(0))
    force = jnp.asarray(thrust)[:, None] * chain.units.heading
    obs = observe(policy.card.observation, chain, target, force)
    ours = np.asarray(policy.act(replace(begun, obs=obs))).reshape(-1)
    save_policy(policy, tmp_path / "policy.safetensors")
    export(policy, tmp_path / "policy.onnx", "onnx")
    halves = base64.b64decode(swim_page.weights(policy))
    files = [(tmp_path / f"policy.{kind}").read_bytes() for kind in ("safetensors", "onnx")]
    for file in (*files, halves):
        np.testing.assert_allclose(page_actions(file, chain, target, thrust), ours, atol=1e-4)
    assert np.abs(ours).max() > 0.01


def refusal(content):
    data = {"file": base64.b64encode(content).decode()}
    return ask("refusal(() => Policy.fromFile(bytesOf(DATA.file)))", data)


def test_a_file_that_is_no_policy_of_the_page_is_refused_in_a_sentence(tmp_path):
    good = base64.b64decode(swim_page.weights(salpchain.load("any-length")))
    size = int.from_bytes(good[:8], "little")
    header = json.loads(good[8 : 8 + size])

    def changed(change, body=good[8 + size :]):
        other = json.loads(json.dumps(header))
        change(other)
        text = json.dumps(other).encode()
        return len(text).to_bytes(8, "little") + text + body

    def about(change):
        def edit(other):
            inner = json.loads(other["__metadata__"]["salpchain"])
            change(inner["header"])
            other["__metadata__"]["salpchain"] = json.dumps(inner)

        return changed(edit)

    assert refusal(good) == ""
    assert "cut short" in refusal(good[:-100])
    assert "whole" in refusal(good[:5])
    assert "whole" in refusal(b"\x00" * 400)
    assert "no layer" in refusal(changed(lambda h: h.pop("actor.layers[1].weight")))
    assert "damaged" in refusal(changed(lambda h: h["actor.layers[1].bias"].update(shape=[64])))
    assert "do not fit" in refusal(about(lambda card: card.update(observation="jets")))
    assert "observes" in refusal(about(lambda card: card.update(observation="__proto__")))
    assert "gt on mixed" in refusal(about(lambda card: card["control"].update(model="gt")))
    assert "no policy" in refusal(changed(lambda h: h["__metadata__"].update(salpchain="{}")))
    numbers = np.frombuffer(good[8 + size :], np.float16).copy()
    numbers[5] = np.nan
    assert "numbers" in refusal(changed(lambda h: None, numbers.tobytes()))
    export(salpchain.load("paper-gt-8"), tmp_path / "gt.onnx", "onnx")
    assert "gt on mixed" in refusal((tmp_path / "gt.onnx").read_bytes())


# --- edits and links ------------------------------------------------------------------------------


def test_drawn_lines_become_the_same_targets():
    line = np.cumsum(np.random.default_rng(0).normal(0, 0.05, (40, 2)), axis=0)
    ours = drawing.resampled(line, 20)
    pages = ask("Pond.resampled(DATA, 20)", line.tolist())
    np.testing.assert_allclose(pages, ours, atol=1e-9)
    dot = "refusal(() => Pond.resampled([[0, 0], [0.001, 0]], 4))"
    assert "hardly more than a dot" in ask(dot)


def test_the_goal_is_the_frechet_distance():
    dice = np.random.default_rng(1)
    one = np.cumsum(dice.normal(0, 0.05, (30, 2)), axis=0)
    other = one + dice.normal(0, 0.02, one.shape)
    leash = float(frechet_distance(jnp.asarray(one), jnp.asarray(other)))
    within = "DATA.limits.map((limit) => Pond.within(DATA.one, DATA.other, limit))"
    limits = [leash - 1e-5, leash + 1e-5]
    data = {"one": one.tolist(), "other": other.tolist(), "limits": limits}
    assert ask(within, data) == [False, True]


EDIT = """(() => {
  const { apart, ...json } = DATA, all = () => true;
  const straight = Pond.laid(1, json.points, json.points.map(() => json.angle), json.target);
  const one = { ...straight, chain: chainOf(json.chain) }, parts = Pond.cut(one, 2, 2);
  const grown = Pond.grown(one, [], all), turned = Pond.turnedRound(one);
  const whole = Pond.joined(parts[0], parts[1], all);
  return [one, ...parts, grown, turned, whole].map(({ chain, target }) => ({
    units: rowsOf(chain.units), links: rowsOf(chain.links), rest: Array.from(chain.rest), target,
  }));
})()"""


def test_cutting_growing_turning_and_joining_are_those_of_the_live_page():
    one = swimmer.straight(1, 6, np.zeros(2), 0.4, np.arange(12.0).reshape(6, 2) / 10)
    dice = np.random.default_rng(2)
    one = replace(one, units=one.units + dice.normal(0, 1e-3, (6, 6)))
    parts = swimmer.cut(one, 2, 2)
    ours = [one, *parts, swimmer.grown(one, np.empty((0, 2))), swimmer.turned_round(one)]
    ours.append(swimmer.joined(*parts))
    chain = {"units": one.units.tolist(), "links": one.links.tolist(), "rest": one.rest.tolist()}
    data = {"chain": chain | {"linked": [1] * 5}, "points": one.units[:, :2].tolist()}
    pages = ask(EDIT, data | {"angle": 0.4, "target": one.target.tolist()})
    for mine, its in zip(ours, pages, strict=True):
        for name in ("units", "links", "target"):
            np.testing.assert_allclose(its[name], getattr(mine, name), atol=1e-9)
        np.testing.assert_allclose(np.reshape(its["rest"], mine.rest.shape), mine.rest, atol=1e-9)


def test_a_link_carries_its_scene_and_a_damaged_one_gets_a_sentence():
    links = [
        "#length=2&seed=7&world=posts&target=0.1,-0.2,0.17,-0.2", "", "#length=129",
        "#length=2&target=0,0", "#world=moon", "#length=8.5", "#seed=-1", "#target=1e999,0",
        "#__proto__=1", "#length=%E0%A4%A", "#length=8=9", "#length=<script>",
        "#troubles=dead,noise&grade=hard",
    ]  # fmt: skip
    scenes = ask("DATA.map((hash) => Scenes.parse(hash))", links, scripts=["scenes"])
    first = {"length": 2, "seed": 7, "world": "posts", "target": [[0.1, -0.2], [0.17, -0.2]]}
    assert scenes[0] == {"scene": first, "wrong": ""} and scenes[1] == {"scene": {}, "wrong": ""}
    assert scenes[-1]["scene"] == {"troubles": ["dead", "noise"], "grade": "hard"}
    for damaged in scenes[2:-1]:
        assert damaged["scene"] == {} and damaged["wrong"].startswith("The link is damaged: it")


# --- how well it does ---------------------------------------------------------------------------

PLAY = "DATA.starts.map((one) => Tank.play(Policy.fromFile(bytesOf(DATA.file)), one, DATA.limit))"


def played(length, episodes, seed=0):
    """Success of the page and of Python on the same starts."""
    policy = salpchain.load("any-length")
    env = SCLD(policy.card.task(length))
    starts = jax.vmap(env.reset)(jr.split(jr.key(seed), episodes))
    chain = starts.chain.units
    units = np.concatenate([chain.position, chain.angle[..., None]], axis=-1).astype(float)
    data = {
        "file": swim_page.weights(policy), "limit": env.config.step_limit,
        "starts": [{"units": u, "target": t} for u, t in
                   zip(units.tolist(), np.asarray(starts.target, float).tolist(), strict=True)],
    }  # fmt: skip
    return ask(PLAY, data), python_plays(policy, env, starts)


def python_plays(policy, env, states):
    @jax.jit
    def play(states):
        def advance(_, carry):
            states, done = carry
            states = jax.vmap(lambda s: env.step(s, policy.act(s)))(states)
            return states, done | states.goal

        none = jnp.zeros(states.time.shape, bool)
        return jax.lax.fori_loop(0, env.config.step_limit, advance, (states, none))[1]

    return np.asarray(play(states))


@pytest.mark.slow
@pytest.mark.parametrize("length", [8, 32])
def test_it_succeeds_as_often_as_python_on_the_same_starts(length):
    pages, ours = played(length, 100)
    success = np.mean([episode["success"] for episode in pages])
    print(f"{length} units: page {success:.2f}, Python {ours.mean():.2f} of 100 episodes")
    assert abs(success - ours.mean()) <= 0.03, (success, ours.mean())
