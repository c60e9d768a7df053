"""Of two that would write to one place, one is refused; nothing is lost, nothing half written."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from salpchain.cli.main import run
from salpchain.errors import InputError
from salpchain.experiments.results import claim
from salpchain.files import writing

LIMIT = 240  # s, a wait for ever must fail
SHORT = ["--length", "2", "--steps", "1"]

pytestmark = pytest.mark.skipif(os.name != "posix", reason="the system has no such locks")


@pytest.fixture(scope="module")
def swim(tmp_path_factory):
    out = tmp_path_factory.mktemp("swims") / "swim.npz"
    assert run(["rollout", "greedy", "--length", "2", "--out", str(out)]) == 0
    return out


def commands(folder, swim):
    """Each command that writes, and the file that it would write."""
    return {
        "rollout": (["rollout", "greedy", "--length", "2"], folder / "swim.npz"),
        "replay": (["replay", str(swim)], folder / "swim.html"),
        "video": (["video", str(swim)], folder / "swim.png"),
        "export": (["export", "any-length", "--format", "torch"], folder / "salps.safetensors"),
        "figure": (["figure", "learning", str(folder)], folder / "learning.png"),
    }


@pytest.mark.parametrize("name", ["rollout", "replay", "video", "export", "figure"])
def test_a_file_that_another_process_is_writing_is_refused(name, swim, tmp_path, capsys):
    arguments, out = commands(tmp_path, swim)[name]
    out.write_text("before")
    with writing(out):
        assert run([*arguments, "--out", str(out)]) == 2
    assert "is being written by another process: wait for its end" in capsys.readouterr().err
    assert out.read_text() == "before"
    assert [path.name for path in tmp_path.iterdir()] == [out.name]


@pytest.mark.parametrize(
    ("arguments", "held"),
    [
        (["evaluate", "greedy", "--lengths", "2", "--trials", "1"], "evaluation.json"),
        (["demo", "--lengths", "2", "--steps", "1"], "demo"),
    ],
)
def test_a_folder_that_another_process_writes_results_to_is_refused(
    arguments, held, tmp_path, capsys
):
    with writing(tmp_path / held):
        assert run([*arguments, "--out", str(tmp_path)]) == 2
    assert "by another process" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_study_that_another_process_is_at_is_refused(tmp_path):
    with writing(tmp_path / "about.json"), pytest.raises(InputError, match="by another process"):
        claim(tmp_path, "short")
    claim(tmp_path, "short")
    claim(tmp_path, "short")  # the same process again
    with pytest.raises(InputError, match="by another process"), writing(tmp_path / "about.json"):
        pass


@pytest.mark.slow
def test_of_two_trainings_that_begin_at_once_one_has_the_folder(tmp_path):
    """The settings in the folder are those of the one that trained."""
    out = tmp_path / "run"
    command = [sys.executable, "-m", "salpchain", "train", *SHORT, "--out", str(out), "--seed"]
    both = [
        subprocess.Popen([*command, seed], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        for seed in ("1", "2")
    ]
    errors = [process.communicate(timeout=LIMIT)[1].decode() for process in both]
    assert sorted(process.returncode for process in both) == [0, 2], errors
    won = [process.returncode for process in both].index(0)
    assert "in use by another process" in errors[1 - won] or "already used" in errors[1 - won]
    for name in ("config.json", "summary.json"):
        content = json.loads((out / name).read_text())
        assert content.get("config", content)["seed"] == won + 1


def test_a_process_that_was_killed_keeps_nothing_from_the_next(tmp_path):
    code = (
        "import sys, time; from salpchain.files import writing\n"
        "with writing(sys.argv[1]): print('holds', flush=True); time.sleep(600)"
    )
    path = tmp_path / "swim.npz"
    holder = subprocess.Popen([sys.executable, "-c", code, path], stdout=subprocess.PIPE)
    assert holder.stdout is not None and holder.stdout.readline() == b"holds\n"
    with pytest.raises(InputError, match="by another process"), writing(path):
        pass
    holder.kill()
    holder.wait(LIMIT)
    with writing(path):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_missing_folder_is_named_by_the_file_that_was_asked_for(tmp_path):
    with pytest.raises(FileNotFoundError) as caught, writing(tmp_path / "no" / "swim.npz"):
        pass
    assert Path(caught.value.filename) == tmp_path / "no" / "swim.npz"
