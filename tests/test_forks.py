"""JAX does not survive a fork: what would wait for ever is refused in one line, nothing else is."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = Path(__file__).parent / "forked.py"
LIMIT = 240  # s, a hang must fail
WORDS = ("JAX was started before this process was forked", "spawn", "make_vec")

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="the system has no fork")


def run(which):
    """What each worker of a program answered, and what was printed to standard error."""
    done = subprocess.run(
        [sys.executable, PROGRAM, which], capture_output=True, text=True, timeout=LIMIT
    )
    assert done.returncode == 0, done.stderr
    lines = [line for line in done.stdout.splitlines() if line.startswith('["')]
    return dict(map(json.loads, lines)), done.stderr


def is_refused(answer):
    return answer.startswith("InputError") and all(word in answer for word in WORDS)


def test_the_package_refuses_a_forked_worker_and_writes_nothing():
    answers, _ = run("core")
    assert len(answers) == 14
    assert [name for name, answer in answers.items() if not is_refused(answer)] == []


@pytest.mark.slow
def test_every_bridge_refuses_a_forked_worker_but_the_one_that_needs_no_jax():
    answers, _ = run("bridges")
    assert answers.pop("VMAS") == "worked"
    assert len(answers) == 7
    assert [name for name, answer in answers.items() if not is_refused(answer)] == []


def test_pools_of_other_tools_end_at_once_and_tell_why():
    answers, errors = run("others")
    assert is_refused(answers["AsyncVectorEnv"])
    assert answers["SubprocVecEnv"].startswith("EOFError")  # its workers tell, it does not
    assert errors.count(f"InputError: {WORDS[0]}") >= 2
    assert all(word in answers["DataLoader"] for word in WORDS)


def test_spawned_workers_step():
    answers, _ = run("spawned")
    assert answers == {"AsyncVectorEnv": "(2, 2, 22)"}


def test_what_was_forked_before_jax_started_or_is_a_program_of_its_own_works():
    answers, _ = run("early")
    assert is_refused(answers.pop("forked after"))
    assert answers == {"forked before": "worked", "program": "any-length", "here": "worked"}


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux counts threads")
def test_a_worker_that_imports_the_package_itself_is_refused_too():
    answers, _ = run("late")
    assert is_refused(answers["late"])
