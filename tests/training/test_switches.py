"""Global switches of JAX: everything works under each, or is refused in a line with the remedy."""

import json
import os
import subprocess
import sys

import pytest

from salpchain.control.storage import load
from salpchain.training.trainer import resume, train
from tests.training.small import small

SWITCHES = {
    "x64": {"JAX_ENABLE_X64": "1"},
    "rbg": {"JAX_DEFAULT_PRNG_IMPL": "rbg"},
    "strict": {"JAX_NUMPY_DTYPE_PROMOTION": "strict", "JAX_NUMPY_RANK_PROMOTION": "raise"},
    "mesh": {},
}
REFUSED = {
    "x64": "with float32 floats, here are float64: set JAX_ENABLE_X64=0 to go on",
    "rbg": "with threefry2x32 keys, here are rbg: set JAX_DEFAULT_PRNG_IMPL=threefry2x32 to go on",
}


@pytest.fixture
def run(tmp_path):
    train(small(2), tmp_path / "plain")
    return tmp_path / "plain"


@pytest.mark.parametrize("switch", SWITCHES)
def test_under_every_switch_all_works_or_names_the_remedy(switch, run, tmp_path):
    kind, new = ("mesh" if switch == "mesh" else "plain"), tmp_path / "new"
    words = [sys.executable, "-m", "tests.training.switched", kind, str(new), str(run)]
    environment = {**os.environ, **SWITCHES[switch]}
    done = subprocess.run(words, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    lines = [line for line in done.stdout.splitlines() if line]
    if switch in REFUSED:
        assert len(lines) == 1 and lines[0].startswith("resume: ") and REFUSED[switch] in lines[0]
    else:
        assert lines == []
    assert load(new).card.name == "gcn-mixed-3"  # in this process, without the switch


def test_a_run_of_more_devices_than_there_are_goes_on_and_says_so(run):
    path = run / "config.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "devices": 64}))
    (run / "summary.json").unlink()
    (run / "checkpoint.safetensors").unlink()
    told = []
    resume(run, told.append)
    assert told[0].note.startswith("goes on over ") and "64 devices" in told[0].note
    assert json.loads(path.read_text())["devices"] < 64
    assert (run / "summary.json").exists()


def test_a_finished_run_is_left_as_it_is(run):
    before = {path: path.read_bytes() for path in run.rglob("*") if path.is_file()}
    assert resume(run) == json.loads((run / "summary.json").read_text())
    assert {path: path.read_bytes() for path in run.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize("devices", [0, -1, "cpu", 1.5])
def test_a_number_of_devices_that_cannot_be_is_refused(run, devices):
    (run / "summary.json").unlink()
    program = (
        "import sys, salpchain\n"
        "try:\n    salpchain.resume(sys.argv[1], devices=eval(sys.argv[2]))\n"
        "except salpchain.InputError as error:\n    print(error)"
    )
    words = [sys.executable, "-c", program, str(run), repr(devices)]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == f"devices must be a whole number, 1 or more, got {devices!r}"
