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
from salpchain.controllers.by_jet import by_jet
from salpchain.controllers.policy import PolicyCard, as_policy
from salpchain.controllers.storage import save_policy
from salpchain.interop.export import export
from salpchain.networks.actor_critic import actor_critic
from salpchain.networks.config import ControlConfig
from salpchain.physics.chain import step
from salpchain.physics.state import Physics, at_rest
from salpchain.tasks.config import TaskConfig
from salpchain.tasks.features import OBSERVATIONS, observation_size
from salpchain.tasks.observations import Around, observe
from salpchain.tasks.reach.task import SCLD
from salpchain.web import swim_page
from salpchain.world.current import Shear, Uniform, Vortex, carried
from salpchain.world.obstacles import make_obstacles
from salpchain.world.thrusters import Thrusters
from salpchain.world.world import World
from tests.web.engine import as_json, ask, columns
from tests.web.episodes import episodes, python_plays

STEPS = 100
STILL, USUAL = Uniform(), Physics()
RUN = """(() => {
  const flowsOf = ({ vortex, shear, current }) => (
    vortex ? Sea.vortex(...vortex) : shear ? Sea.shear(...shear) : flowOf(current));
  const chain = chainOf(DATA.chain), found = [];
  let touching = 0, blocked = 0;
  DATA.thrust.forEach((row) => {
    Physics.step(chain, row, { contact: DATA.contact, scale: DATA.scale, current: flowsOf(DATA),
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


@eqx.filter_jit
def advance(chain, row, flow, physics, contact, obstacles):
    drifting = carried(chain, flow, physics)
    return step(drifting, row, physics, contact=contact, obstacles=obstacles)


def _swum(chain, thrust, contact=True, walls=(), posts=(), flow=STILL, physics=USUAL):
    obstacles = None
    if walls or posts:
        obstacles = make_obstacles(
            [((ax, ay), (bx, by), width) for ax, ay, bx, by, width in walls],
            [((x, y), radius) for x, y, radius in posts],
        )

    found, touching = [], 0
    for row in thrust:
        chain = advance(chain, row, flow, physics, contact, obstacles)
        touching += bool(chain.touching)
        found.append(columns(chain.units))
    return np.stack(found), touching


def page_swum(chain, thrust, contact=True, walls=(), posts=(), current=(0.0, 0.0), **more):
    data = {"chain": as_json(chain), "thrust": thrust.tolist(), "contact": contact}
    data |= {"walls": walls, "posts": posts, "current": list(current), **more}
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


def displaced(chain, dice):
    """The chain in double precision, every coordinate of its units off by a rounding, 1e-16 m."""
    off = dice.choice([-1e-16, 1e-16], size=chain.units.position.shape)
    cast = jax.tree.map(lambda x: jnp.asarray(np.asarray(x)) if eqx.is_array(x) else x, chain)
    place = jnp.asarray(np.asarray(chain.units.position, float) + off)
    return eqx.tree_at(lambda c: c.units.position, cast, place)


@pytest.mark.parametrize("length", [2, 8, 32])
def test_after_ten_steps_it_is_as_near_to_the_engine_as_that_is_to_itself(length):
    """A start that is off by a rounding leads as far away: no port can be much nearer.

    A port rounds otherwise in every substep, a twin once: so ten times as far is allowed.
    """
    for seed in range(4):
        chain, thrust = start(length, seed).chain, thrusts(length, seed)[:10]
        ours, _ = swum(chain, thrust, contact=False)
        pages, _, _ = page_swum(chain, thrust, contact=False)
        dice = np.random.default_rng(0)
        with jax.enable_x64(True):
            twins = [displaced(chain, dice) for _ in range(4)]
        own = max(apart(ours, swum(twin, thrust, contact=False)[0])[9] for twin in twins)
        print(f"{length} units, start {seed}: page {apart(ours, pages)[9]:.1e}, itself {own:.1e} m")
        assert apart(ours, pages)[9] < max(1e-5, 10 * own)


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
    assert touched > 20 and abs(touching - touched) <= 10
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
    ours, _ = swum(chain, thrust, flow=Uniform((0.03125, -0.015625)), **around)
    pages, _, blocked = page_swum(chain, thrust, current=(0.03125, -0.015625), **around)
    away = apart(ours, pages)
    print(f"among walls: {away[4]:.1e} m after 5, {away[-1]:.1e} m after 100, blocked {blocked}")
    assert blocked > 20
    assert away[4] < 1e-7 and away[-1] < 1e-2


@pytest.mark.parametrize("kind", ["vortex", "shear", "scale"])
def test_water_that_turns_and_other_physics_move_it_as_in_python(kind):
    chain = start(8, 6).chain
    centre, thrust = (0.125, 0.25), np.zeros((STEPS, 8))  # exact in single precision
    flow, physics, more = {
        "vortex": (Vortex(0.0625, 0.25, centre), USUAL, {"vortex": [0.0625, 0.25, list(centre)]}),
        "shear": (Shear(0.25, 0.75), USUAL, {"shear": [0.25, 0.75]}),
        "scale": (STILL, replace(USUAL, unit_mass=1.3, link_mass=1.3, drag=0.3,
                                 joint_stiffness=720.0, angle_stiffness=0.08),
                  {"scale": {"mass": 1.3, "drag": 1.2, "stiffness": 0.8}}),
    }[kind]  # fmt: skip
    thrust = thrusts(8, 3) if kind == "scale" else thrust
    ours, _ = swum(chain, thrust, flow=flow, physics=physics)
    pages, _, _ = page_swum(chain, thrust, **more)
    usually, _ = swum(chain, thrust)
    away = apart(ours, pages)
    print(f"{kind}: {away[[0, 4, -1]]} m, {apart(ours, usually)[-1]:.2f} of the usual")
    assert away[4] < 1e-6 and away[-1] < 1e-3
    assert apart(ours, usually)[-1] > 0.01  # it matters


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


@pytest.mark.parametrize("one_way", [True, False])
def test_a_policy_of_two_networks_acts_by_the_jets_as_here(one_way, tmp_path):
    size = observation_size("jets")
    apart = [
        as_policy(
            actor_critic(jr.key(seed), ControlConfig(), size, 1, 8), PolicyCard(observation="jets")
        )
        for seed in (1, 2)
    ]
    both = by_jet(*apart, "both")
    save_policy(both, tmp_path / "policy.safetensors")
    chain, target, thrust, _ = state(5, 8)
    gain = np.array([1, 1, 0, 1, 1], np.float32)
    world = World(thrusters=Thrusters(jnp.asarray(gain), one_sided=one_way))
    force = jnp.asarray(thrust)[:, None] * chain.units.heading
    obs = observe("jets", chain, target, force, Around(world, 0))
    here = [
        np.asarray(policy.network.act(obs, chain.present, chain.joined)).reshape(-1)
        for policy in (both, *apart)
    ]
    about = told(chain, target, thrust, gain, (0, 0)) | {"oneSided": one_way}
    file = base64.b64encode((tmp_path / "policy.safetensors").read_bytes()).decode()
    np.testing.assert_allclose(ask(ACT, {"file": file, "state": about}), here[0], atol=1e-5)
    assert np.abs(here[1] - here[2]).max() > 1e-4


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
    assert "remember" in refusal(about(lambda card: card["control"].update(memory=True)))
    save_policy(salpchain.load("any-length-landsalp"), tmp_path / "land.safetensors")
    assert "landsalp" in refusal((tmp_path / "land.safetensors").read_bytes())
    assert "no policy" in refusal(changed(lambda h: h["__metadata__"].update(salpchain="{}")))
    numbers = np.frombuffer(good[8 + size :], np.float16).copy()
    numbers[5] = np.nan
    assert "numbers" in refusal(changed(lambda h: None, numbers.tobytes()))
    export(salpchain.load("paper-gt-8"), tmp_path / "gt.onnx", "onnx")
    assert "gt on mixed" in refusal((tmp_path / "gt.onnx").read_bytes())


# --- how well it does ---------------------------------------------------------------------------

PLAY = "DATA.starts.map((one) => Tank.play(Policy.fromFile(bytesOf(DATA.file)), one, DATA.limit))"


@pytest.mark.slow
@pytest.mark.parametrize("length", [8, 32])
def test_it_succeeds_as_often_as_python_on_the_same_starts(length):
    data, states = episodes(length, 100)
    pages, ours = ask(PLAY, data), python_plays(length, states)
    success = np.mean([episode["success"] for episode in pages])
    print(f"{length} units: page {success:.2f}, Python {ours.mean():.2f} of 100 episodes")
    assert abs(success - ours.mean()) <= 0.03, (success, ours.mean())
