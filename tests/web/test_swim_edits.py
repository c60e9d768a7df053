"""What a person does on the swim page against the live page's own: lines, cuts, joints, links."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np

from salpchain.tasks.reach.frechet import frechet_distance
from salpchain.web import drawing, swimmer
from tests.web.engine import ask


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
        "#length=8&pieces=4,3", "#length=8&pieces=7,1", "#length=8&pieces=", "#pieces=4,a",
        "#troubles=dead,noise&grade=hard",
    ]  # fmt: skip
    scenes = ask("DATA.map((hash) => Scenes.parse(hash))", links, scripts=["scenes"])
    first = {"length": 2, "seed": 7, "world": "posts", "target": [[0.1, -0.2], [0.17, -0.2]]}
    assert scenes[0] == {"scene": first, "wrong": ""} and scenes[1] == {"scene": {}, "wrong": ""}
    assert scenes[-1]["scene"] == {"troubles": ["dead", "noise"], "grade": "hard"}
    for damaged in scenes[2:-1]:
        assert damaged["scene"] == {} and damaged["wrong"].startswith("The link is damaged: it")


WORLDS = """DATA.map(([world, seed]) => {
  const policy = { name: "none" }, pond = new Tank.World(policy);
  pond.policy = "greedy";
  pond.reset(12, { seed, world });
  const points = [...Pond.placesOf(pond.chains[0]), ...pond.chains[0].target], water = pond.water;
  pond.pour(["noise"], "easy");
  const found = {
    clear: Math.min(...points.map((point) => Sea.gap(point, pond.around))),
    kept: pond.water === water, walls: pond.around.walls.length, posts: pond.around.posts.length,
    flow: points.map(([x, y]) => pond.flow(x, y)), seen: pond.told.water?.shape ?? null,
    scale: pond.scale ?? null,
  };
  for (let k = 0; k < 5; k++) pond.advance();
  return { ...found, swims: pond.chains[0].chain.units.x.every(Number.isFinite) };
})"""


def test_a_world_is_drawn_as_its_settings_say():
    names = ("posts", "room", "vortex", "current", "rough", "failing", "noisy", "still")
    asked = [(name, seed) for name in names for seed in range(5)]
    found = {name: [] for name in names}
    for (name, _), one in zip(asked, ask(WORLDS, asked), strict=True):
        assert one["swims"] and one["kept"]  # noise that is poured on leaves the water as it was
        found[name].append(one)
    assert all(one["clear"] > 0.05 for name in ("posts", "room") for one in found[name])
    assert all(3 <= one["posts"] <= 8 for one in found["posts"])
    assert {one["walls"] for one in found["room"]} <= {4, 5, 6} != {4}
    assert max(one["walls"] for one in found["room"]) > 4
    for name in ("vortex", "current"):
        ways = [np.ptp(np.array(one["flow"])[:, :2], axis=0).max() for one in found[name]]
        assert (min(ways) > 1e-3) == (name == "vortex")  # another flow in every place
    assert all(one["seen"] == [1, 24, 24] for one in found["vortex"])
    assert all(0.8 <= one["scale"]["mass"] <= 1.2 for one in found["rough"])
    assert all(one["seen"] is None and one["scale"] is None for one in found["still"])
