"""Recordings: what is kept is what swam, whatever was done to the chains, and never too much."""

import base64
import json
import re

import numpy as np
import pytest

from salpchain.controllers.greedy import Greedy
from salpchain.errors import InputError
from salpchain.report.recorded import Part, Recording, packed_part, recording_page
from salpchain.web import recorder as module
from salpchain.web import swimmer
from salpchain.web.pool import Pool
from salpchain.web.recorder import Recorder, Recordings
from salpchain.web.world import World

POOL = Pool()


class Watched:
    """A world that is recorded, beside a plain list of the chains before and after each step."""

    def __init__(self, length=6):
        self.world, self.recorder, self.seen = World(seed=2), Recorder(0.1), []
        self.world.reset(length)
        self.policy = "greedy"

    def swim(self, steps=1):
        for _ in range(steps):
            before = list(self.world.swimmers)
            self.world.advance(POOL, Greedy())
            after = list(self.world.swimmers)
            self.recorder.keep(before, after, self.world.current, self.policy)
            self.seen.append((before, after))

    @property
    def names(self):
        return [one.name for one in self.world.swimmers]


def check(watched):
    """Each step of the recording against the list: every chain there, where it was, its target."""
    recording = watched.recorder.recording()
    assert recording.steps == len(watched.seen)
    for step, (before, after) in enumerate(watched.seen):
        parts = [part for part in recording.parts if part.begin <= step < part.end]
        assert len(parts) == len(after)
        for one, then in zip(before, after, strict=True):
            (part,) = [part for part in parts if is_there(part, step, one)]
            now = step - part.begin
            np.testing.assert_allclose(part.position[now + 1], then.units[:, :2], atol=1e-6)
            np.testing.assert_allclose(part.angle[now + 1], then.units[:, 2], atol=1e-5)
            np.testing.assert_allclose(part.thrust[now], then.thrust, atol=1e-6)
            np.testing.assert_array_equal(part.works, one.works)
            target = [points for begin, points in part.targets if begin <= now][-1]
            np.testing.assert_array_equal(target, one.target)
            assert part.distance[now + 1] == then.distance and part.reached[now + 1] == then.reached
    return recording


def is_there(part, step, one):
    now = part.position[step - part.begin]
    return len(now) == one.length and np.allclose(now, one.units[:, :2], atol=1e-6)


def test_a_recording_is_what_swam_through_every_edit():
    watched = Watched()
    world, (name,) = watched.world, watched.names
    edits = [
        lambda: world.place(name, 0.4, 0.1, 0.3),
        lambda: world.grow(name),
        lambda: world.cut(name, 3),
        lambda: world.switch(name, 1, False),
        lambda: (world.shrink(name), world.grow(name)),
        lambda: world.retarget(watched.names[1]),
        lambda: world.push(name, 0, 1.0, 1.0),
        lambda: world.flow(0.1, 0.0),
        lambda: (world.join(*watched.names), world.cut(name, 2)),
        lambda: world.reset(5),
        lambda: world.draw(watched.names[0], [(0.0, 0.0), (1.0, 0.5)]),
    ]
    watched.swim(3)
    for edit in edits:
        edit()
        watched.swim(2)
    recording = check(watched)
    assert [entry[1:] for entry in recording.current] == [(0.0, 0.0), (0.1, 0.0)]
    lengths = {len(part.works) for part in recording.parts}
    assert lengths >= {6, 7, 4, 3, 5}


def test_moving_a_target_begins_no_new_part_and_another_policy_does():
    watched = Watched()
    (name,) = watched.names
    for k in range(4):
        watched.world.place(name, 0.1 * k, 0.0, 0.0)
        watched.swim()
    watched.policy = "other"
    watched.swim(2)
    recording = check(watched)
    assert [(part.policy, part.begin, part.end) for part in recording.parts] == [
        ("greedy", 0, 4),
        ("other", 4, 6),
    ]
    assert len(recording.parts[0].targets) == 4 and len(recording.parts[1].targets) == 1


def test_an_edit_that_no_step_followed_is_not_in_the_recording():
    watched = Watched()
    watched.swim(2)
    watched.world.cut(watched.names[0], 2)
    assert len(check(watched).parts) == 1


def test_without_a_step_there_is_no_recording():
    recordings = Recordings(0.1)
    with pytest.raises(InputError, match="nothing is being recorded"):
        recordings.stop()
    recordings.start()
    with pytest.raises(InputError, match="runs already"):
        recordings.start()
    with pytest.raises(InputError, match="nothing was recorded"):
        recordings.stop()
    recordings.start()  # the empty one is gone


def test_a_recording_is_full_after_so_many_steps_or_parts(monkeypatch):
    monkeypatch.setattr(module, "LONGEST", 5)
    watched = Watched()
    watched.swim(4)
    assert not watched.recorder.full
    watched.swim()
    assert watched.recorder.full
    monkeypatch.setattr(module, "MOST_PARTS", 3)
    watched = Watched()
    for on in (True, False, True):
        assert not watched.recorder.full
        watched.world.switch(watched.names[0], 0, on)
        watched.swim()
    assert watched.recorder.full


def test_only_the_last_recordings_are_kept_and_one_is_written_at_a_time():
    recordings, watched = Recordings(0.1), Watched()
    watched.swim()
    for number in range(1, module.KEPT + 3):
        recordings.start()
        recordings.running = watched.recorder
        recording = recordings.stop()
        with pytest.raises(InputError, match="being written"):
            recordings.start()
        recordings.add(recording, lambda _, number=number: f"page {number}")
        assert recordings.newest == number
    kept = [number for number in range(module.KEPT + 4) if recordings.page(number)]
    assert kept == [3, 4, 5] and recordings.page(5) == b"page 5"


def numbers(packed, kind):
    return np.frombuffer(base64.b64decode(packed), kind).astype(float)


def test_a_part_in_the_page_is_the_part_to_a_fifth_of_a_millimetre():
    watched = Watched()
    watched.swim(2)
    watched.world.place(watched.names[0], 5.0, -3.0, 1.0)  # a target far from where it swims
    watched.swim(3)
    (part,) = watched.recorder.recording().parts
    packed = packed_part(part, 0.1)

    def metres(text):
        return numbers(text, "<i2").reshape(-1, 6, 2) * packed["grain"] + packed["middle"]

    np.testing.assert_allclose(metres(packed["position"]), part.position, atol=2e-4)
    for (step, target), (begin, text) in zip(part.targets, packed["targets"], strict=True):
        assert step == begin
        np.testing.assert_allclose(metres(text)[0], target, atol=2e-4)


def test_the_longest_recording_makes_a_page_of_a_few_megabytes():
    steps, n = module.LONGEST, 128
    dice = np.random.default_rng(0)
    targets = [(step, dice.normal(size=(n, 2))) for step in range(0, steps, 2)]
    part = Part(
        0, "any", 0, np.ones(n, bool), dice.normal(size=(steps + 1, n, 2)),
        dice.normal(size=(steps + 1, n)), dice.normal(size=(steps, n)), np.ones(steps + 1),
        np.zeros(steps + 1, bool), targets, np.zeros((steps + 1, n - 1), bool),
    )  # fmt: skip
    assert len(recording_page(Recording([part], [(0, 0.0, 0.0)], 0.1))) < 6_000_000


def test_the_page_says_how_long_by_whom_and_how_many_and_a_name_stays_a_name():
    watched = Watched()
    watched.swim(2)
    watched.world.cut(watched.names[0], 2)
    watched.policy = "</script><script>alert(1)</script>"
    watched.swim(3)
    text = recording_page(watched.recorder.recording())
    data = json.loads(re.search(r'id="data">(.*?)</script>', text, re.DOTALL)[1])
    assert data["world"]["about"] == f"0.5 s, up to 2 chains, steered by greedy, {watched.policy}"
    assert text.count("<script") == 6 and watched.policy not in text
    assert [swim["chain"] for swim in data["swims"]] == [0, 0, 1]


def test_turned_round_and_back_a_chain_is_still_seen_as_another_array():
    """What is compared is whether an edit made new arrays, not whether numbers look alike."""
    watched = Watched()
    watched.swim()
    (one,) = watched.world.swimmers
    watched.world.swimmers = [swimmer.turned_round(one)]
    watched.swim()
    assert len(check(watched).parts) == 2
