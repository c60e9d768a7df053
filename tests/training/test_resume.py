"""A killed run goes on bit for bit; damaged files are refused by name."""

import csv
import json
import os
import random
import signal
import subprocess
import sys
import time

import pytest
import tensorboardX
from tensorboardX import SummaryWriter

from salpchain.errors import InputError
from salpchain.files import alone
from salpchain.training.checkpoint import CHECKPOINT_FILE
from salpchain.training.trainer import resume, train
from tests.training.small import small

ITERATIONS = 40
COLUMNS = b"iteration,steps,seconds,episodes,success,closed_fraction,reward_approach,reward_goal\n"


def start(folder, cache):
    command = [sys.executable, "-m", "tests.training.small", str(folder), str(ITERATIONS)]
    return subprocess.Popen(
        command, env={"JAX_COMPILATION_CACHE_DIR": str(cache), **os.environ},
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip


def rows(folder):
    path = folder / "metrics.csv"
    return list(csv.DictReader(path.open())) if path.exists() else []


def finish(process):
    _, said = process.communicate(timeout=240)
    assert process.returncode == 0, said.decode()


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "undisturbed"
    finish(start(folder, folder.parent / "cache"))
    return folder


@pytest.mark.slow
def test_a_run_killed_again_and_again_ends_with_the_weights_of_one_never_disturbed(undisturbed):
    folder, cache = undisturbed.parent / "killed", undisturbed.parent / "cache"
    chance = random.Random(0)
    kills = 0
    for goal in (1, 14, 27):
        process = start(folder, cache)
        while process.poll() is None and len(rows(folder)) < goal:
            time.sleep(0.01)
        time.sleep(chance.uniform(0, 0.05))
        process.send_signal(signal.SIGKILL)
        kills += process.wait() == -signal.SIGKILL
    assert kills == 3
    finish(start(folder, cache))
    for name in (CHECKPOINT_FILE, "policy.safetensors"):
        assert (folder / name).read_bytes() == (undisturbed / name).read_bytes()
    apart = {"seconds", "steps_per_second"}
    ours, theirs = (
        [{k: v for k, v in row.items() if k not in apart} for row in rows(run)]
        for run in (folder, undisturbed)
    )
    assert len(ours) == ITERATIONS and ours == theirs


@pytest.mark.slow
def test_ctrl_c_saves_and_the_run_goes_on(undisturbed):
    folder, cache = undisturbed.parent / "interrupted", undisturbed.parent / "cache"
    process = start(folder, cache)
    while process.poll() is None and not rows(folder):
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=60)
    assert process.returncode != 0 and 0 < len(rows(folder)) < ITERATIONS
    finish(start(folder, cache))
    assert (folder / CHECKPOINT_FILE).read_bytes() == (undisturbed / CHECKPOINT_FILE).read_bytes()


@pytest.mark.slow
def test_ctrl_c_while_compiling_leaves_a_run_that_goes_on(undisturbed):
    folder, cache = undisturbed.parent / "early", undisturbed.parent / "no cache"
    process = start(folder, cache)
    while process.poll() is None and not (folder / "metrics.csv").exists():
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=120)
    assert process.returncode != 0 and len(rows(folder)) <= 1
    finish(start(folder, undisturbed.parent / "cache"))
    assert (folder / CHECKPOINT_FILE).read_bytes() == (undisturbed / CHECKPOINT_FILE).read_bytes()


@pytest.mark.slow
def test_ctrl_c_while_the_log_opens_leaves_it_closed_and_the_run_goes_on(tmp_path, monkeypatch):
    boards = []

    def interrupted(*args, **settings):
        if not boards:
            signal.raise_signal(signal.SIGINT)
        boards.append(SummaryWriter(*args, **settings))
        return boards[-1]

    monkeypatch.setattr(tensorboardX, "SummaryWriter", interrupted)
    with pytest.raises(KeyboardInterrupt):
        train(small(2), tmp_path / "run")
    assert [board.file_writer for board in boards] == [None]
    assert resume(tmp_path / "run")["steps"] == small(2).steps


@pytest.mark.slow
def test_a_run_that_another_process_is_at_is_left_alone(undisturbed, tmp_path):
    copy_of(undisturbed, tmp_path)
    with alone(tmp_path), pytest.raises(InputError, match="in use by another process"):
        resume(tmp_path)
    assert not (tmp_path / "summary.json").exists()


def copy_of(undisturbed, tmp_path):
    for name in ("config.json", CHECKPOINT_FILE):
        (tmp_path / name).write_bytes((undisturbed / name).read_bytes())
    return tmp_path / CHECKPOINT_FILE


@pytest.mark.parametrize(
    ("harm", "word"),
    [
        (lambda b: b[: len(b) // 2], "cut short"),
        (lambda b: b[:20], "cut short"),
        (lambda b: b"", "cut short"),
        (lambda b: b[:-5] + bytes([b[-5] ^ 1]) + b[-4:], "altered"),
        (lambda b: b.replace(rb"\"version\": 2", rb"\"version\": 9"), "newer"),
        (lambda b: b.replace(rb"\"version\": 2", rb"\"version\": 1"), "altered"),
    ],
)
def test_a_checkpoint_that_was_harmed_is_refused_and_kept(undisturbed, tmp_path, harm, word):
    path = copy_of(undisturbed, tmp_path)
    harmed = harm(path.read_bytes())
    path.write_bytes(harmed)
    with pytest.raises(InputError, match=word):
        resume(tmp_path)
    assert path.read_bytes() == harmed


@pytest.mark.parametrize(
    ("text", "word"),
    [
        (b"\xff\xfe\x00", "can't decode"),
        (b"step,loss\n1,2\n", "no column 'closed_fraction'"),
        (COLUMNS + b"40,lots,1,1,1,1,1,1\n", "lots"),
        (COLUMNS + b"1,2,3,4,5,6,7,8,9\n", "not a log"),
    ],
    ids=["no text", "another table", "a cell that is no number", "too many cells"],
)
def test_a_log_that_was_harmed_is_refused_and_kept(undisturbed, tmp_path, text, word):
    copy_of(undisturbed, tmp_path)
    (tmp_path / "metrics.csv").write_bytes(text)
    with pytest.raises(InputError, match=word):
        resume(tmp_path)
    assert (tmp_path / "metrics.csv").read_bytes() == text


def test_a_log_that_was_lost_does_not_stop_a_run(undisturbed, tmp_path):
    copy_of(undisturbed, tmp_path)
    assert resume(tmp_path)["steps"] == small(ITERATIONS).total_steps


def test_a_run_killed_before_its_summary_gets_it_and_compiles_nothing(undisturbed, tmp_path):
    copy_of(undisturbed, tmp_path)
    told = []
    resume(tmp_path, on_stage=told.append)
    assert told == ["evaluating the trained policy"] and (tmp_path / "summary.json").exists()


@pytest.mark.parametrize(
    ("group", "name", "value", "word"),
    [("task", "length", 4, "expected"), ("ppo", "momentum", 0.9, "momentum")],
    ids=["another length", "an unknown setting"],
)
def test_settings_that_do_not_fit_the_checkpoint_are_refused(
    undisturbed, tmp_path, group, name, value, word
):
    copy_of(undisturbed, tmp_path)
    config = json.loads((tmp_path / "config.json").read_text())
    config["config"][group][name] = value
    (tmp_path / "config.json").write_text(json.dumps(config))
    with pytest.raises(InputError, match=word):
        resume(tmp_path)


def test_the_small_run_has_as_many_iterations_as_asked():
    assert small(7).iterations == 7
