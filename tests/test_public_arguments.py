"""A wrong argument of a public function is answered with one line, or what is meant is done."""

import json
import os
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

import salpchain
from salpchain.cli import main
from salpchain.controllers.named import names
from salpchain.training import run_folder

ROOT = Path(__file__).parent.parent
LONGEST = 300  # characters of a message that is still read; a list of settings is the longest
# Records that the package fills, a protocol, an exception, a function without arguments
UNASKED = {"Bodies", "Chain", "State", "Policy", "Controller", "Learner", "InputError"}
UNASKED |= {"use_cache"}
# Records that a task or a world checks when it is given them, a table
UNASKED |= {"Start", "Judgement", "Range", "OBSERVATIONS"}


def run(words, **variables):
    """What a program of its own prints, in which nothing but the package checks its arguments."""
    done = subprocess.run(
        [sys.executable, *words],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": str(ROOT), **variables},
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@cache
def outcomes(part):
    return json.loads(run(["-m", "tests.wrong_arguments", part]).splitlines()[-1])


@pytest.mark.slow
@pytest.mark.parametrize("part", ["sweep", "bridges"])
def test_every_argument_of_every_public_function_is_accepted_or_refused_in_one_line(part):
    told = outcomes(part)
    asked = {call.split("(")[0].split(".")[0] for call in told}
    assert part == "bridges" or set(salpchain.__all__) - asked == UNASKED
    assert len(told) > (3000 if part == "sweep" else 800)
    wrong = {
        call: outcome
        for call, outcome in told.items()
        if outcome != "accepted"
        and not (outcome.startswith("refused: ") and "\n" not in outcome and len(outcome) < LONGEST)
    }
    assert wrong == {}


@pytest.mark.slow
def test_what_is_refused_says_what_was_given():
    told = outcomes("sweep")
    for call, outcome in told.items():
        if call.endswith("=a fraction)") and outcome != "accepted":
            assert "2.5" in outcome or "()" in outcome, (call, outcome)
        if call.endswith("=an object)"):
            assert outcome != "accepted", call
        assert "--" not in outcome, call  # a flag of the command line means nothing here


RIGHT = "a run or a policy, or one of any-length"
REFUSED = {
    "evaluate(POLICY, [3], 2.0)": "trials must be a whole number, 1 or more, got 2.0",
    "evaluate(POLICY, [])": "lengths must have at least one, got none",
    "evaluate(salpchain.Greedy, 3)": f"{RIGHT} ... an object with a card and an act, got the class",
    'time_limit="short", out="never")': "unknown time limit 'short': choose one of fixed, scaled",
    'record(Path("nothing"), 3)': "no such run folder or policy: nothing ... any-length",
    'train({}, "q")': 'a TrainConfig, such as salpchain.preset("quick"), got {}',
    "train(CONFIG, None)": "run must be a path, such as 'runs/eight', got None",
    "devices=0)": "devices must be a whole number, 1 or more, got 0",
    "load(None)": f"load takes the path of {RIGHT} ... got None",
    'load("")': "no such run folder or policy: '' (a path, or one of any-length",
    "preset(None)": "unknown preset None: choose one of quick, paper",
    "record(POLICY, None)": "lengths must be a number of units, a list ... 4..16, got None",
    "seed=1.5)": "seed must be a whole number 0 to 4294967295, got 1.5",
    "load(3)": f"load takes the path of {RIGHT} ... got 3",
    'load("a" * 5000)': "no such run folder or policy: aaa",
    'settings=["steps"])': "settings must be a dict such as ... got ['steps']",
    "preset(steps=10)": "steps is a setting: give settings={'steps': 10}",
    "preset(stepz=10)": "unknown setting 'stepz': perhaps steps",
    "task(3, foo=1)": "unknown setting of the task 'foo': choose one of length",
    'task(3, observation="body")': "observation is 'proximity' for any-length, got 'body'",
    'save("missing/swim.npz")': "no such folder: missing (make it",
    'save(".")': ". is a folder",
    "(env=ENV, states=STATE)": "renew_done takes a batch of states ... jax.vmap(env.reset)(keys)",
    "(state=OTHER, action=np.zeros((3, 1)))": "a state of 3 slots ... got one of 4",
    "action=[[0.5], [0, 1], [-0.5]])": "action must be numbers of shape (3, 1), got [[0.5]",
    '"angle": "a"})': "angle must be an array of numbers, got 'a'",
    "jax.jit(": "steering maps NumPy arrays, outside jax.jit ... angle is traced",
    "use_devices(1000)": '1000 devices ... jax.config.update("jax_num_cpu_devices", 1000) before',
    'check_free(".")': "already used: salpchain.resume('.') goes on with it",
    "check_kept(": "kept holds results of one, 2, not of other, 1: ... overwrite=True",
}  # fmt: skip


def test_calls_that_were_seen_to_fail_are_accepted_or_say_what_would_be_right():
    told, said = outcomes("seen"), set()
    for call, outcome in told.items():
        ends = [end for end in REFUSED if end in call]
        assert (outcome == "accepted") == (not ends), (call, outcome)
        for end in ends:
            said.add(end)
            assert outcome.startswith("refused: "), (call, outcome)
            for part in REFUSED[end].split(" ... "):
                assert part in outcome, (call, outcome)
    assert said == set(REFUSED)


def test_the_command_line_names_its_flags_and_python_its_arguments(tmp_path, capsys):
    (tmp_path / "something").touch()
    with pytest.raises(salpchain.InputError) as caught:
        run_folder.check_free(tmp_path)
    assert "salpchain.resume(" in str(caught.value) and "--resume" not in str(caught.value)
    assert main.run(["train", "--out", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert "add --resume" in said and "salpchain.resume(" not in said


START = """
import salpchain
from salpchain import training, evaluation
env = salpchain.SCLD(salpchain.TaskConfig(3))
numbers = [[0.0, 0.0]] * 3
poses = numbers, [0.0] * 3, numbers, [0.0] * 3, numbers
calls = (
    lambda: salpchain.load("any-length"),
    lambda: salpchain.evaluate("any-length", 3),
    lambda: salpchain.evaluate("greedy", 3, out="never"),
    lambda: salpchain.record(salpchain.Greedy(), 3),
    lambda: salpchain.train(salpchain.preset("quick"), "never"),
    lambda: salpchain.steering("greedy", 3)(*poses),
    lambda: env.reset(None),
)
for call in calls:
    try:
        call()
    except salpchain.InputError as error:
        print(error)
"""


def test_a_missing_accelerator_is_one_line_from_every_way_in(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    said = run(["-c", START], JAX_PLATFORMS="cuda").splitlines()
    assert len(said) == 7
    for line in said:
        assert line.startswith("JAX cannot start with JAX_PLATFORMS=cuda: ")
        assert line.endswith("(unset JAX_PLATFORMS, or JAX_PLATFORMS=cpu)")
    assert list(tmp_path.iterdir()) == []


def test_names_in_a_message_are_those_that_there_are():
    told = outcomes("seen")["salpchain.load(3)"]
    assert all(name in told for name in names())
