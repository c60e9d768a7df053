"""Global switches of JAX: everything works under each, or is refused in a line with the remedy."""

import json
import os
import shutil
import subprocess
import sys

import pytest

from salpchain.controllers.storage import load
from salpchain.errors import InputError
from salpchain.training.trainer import resume, train
from tests.training.small import small

SWITCHES = {
    "x64": {"JAX_ENABLE_X64": "1"},
    "rbg": {"JAX_DEFAULT_PRNG_IMPL": "rbg"},
    "unsafe_rbg": {"JAX_DEFAULT_PRNG_IMPL": "unsafe_rbg"},
    "strict": {"JAX_NUMPY_DTYPE_PROMOTION": "strict", "JAX_NUMPY_RANK_PROMOTION": "raise"},
    "mesh": {},
}
# Each takes its time to compile: what another case shows, too, is left out.
HANDLERS = {"rbg": "train", "unsafe_rbg": "swim", "mesh": "mesh,train"}
FLOATS = "with {} floats, here are {}: set JAX_ENABLE_X64={} to go on"
KEYS = "with {} keys, here are {}: set JAX_DEFAULT_PRNG_IMPL={} to go on"
PLAIN = "threefry2x32"
REFUSED = {  # there, what was written here; and here, what was written there
    "x64": (FLOATS.format("float32", "float64", 0), FLOATS.format("float64", "float32", 1)),
    "rbg": (KEYS.format(PLAIN, "rbg", PLAIN), KEYS.format("rbg", PLAIN, "rbg")),
    "unsafe_rbg": (
        KEYS.format(PLAIN, "unsafe_rbg", PLAIN),
        KEYS.format("unsafe_rbg", PLAIN, "unsafe_rbg"),
    ),
}
EXPLICIT = "act: act does not take a batch on a mesh with explicit axes: make the mesh with"


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    folder = tmp_path_factory.mktemp("trained")
    train(small(2), folder / "plain")
    return folder / "plain"


@pytest.fixture
def run(trained, tmp_path):
    return shutil.copytree(trained, tmp_path / "plain")


@pytest.mark.slow
@pytest.mark.parametrize("switch", SWITCHES)
def test_under_every_switch_all_works_or_names_the_remedy(switch, run, tmp_path):
    deeds, new = HANDLERS.get(switch, "swim,train"), tmp_path / "new"
    words = [sys.executable, "-m", "tests.training.switched", deeds, str(new), str(run)]
    environment = {**os.environ, **SWITCHES[switch]}
    done = subprocess.run(words, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    lines = [line for line in done.stdout.splitlines() if line]
    if switch in REFUSED:
        assert len(lines) == 1 and lines[0].startswith("resume: ")
        assert REFUSED[switch][0] in lines[0]
    else:
        assert [line.startswith(EXPLICIT) for line in lines] == [True] * (switch == "mesh")
    if "train" in deeds:  # in this process, without the switch
        assert load(new).card.name == "gcn-mixed-3"
    if "train" in deeds and switch in REFUSED:
        (new / "summary.json").unlink()  # as if it had not come to its end
        with pytest.raises(InputError) as refused:
            resume(new)
        assert REFUSED[switch][1] in str(refused.value)


@pytest.mark.slow
def test_a_run_of_more_devices_than_there_are_goes_on_and_says_so(run):
    path = run / "config.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "devices": 64}))
    (run / "summary.json").unlink()
    (run / "checkpoint.safetensors").unlink()
    told = []
    resume(run, on_stage=told.append)
    assert told[1].startswith("goes on over ") and "64 devices" in told[1]
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
        "import json, sys, salpchain\n"
        "try:\n    salpchain.resume(sys.argv[1], devices=json.loads(sys.argv[2]))\n"
        "except salpchain.InputError as error:\n    print(error)"
    )
    words = [sys.executable, "-c", program, str(run), json.dumps(devices)]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == f"devices must be a whole number, 1 or more, got {devices!r}"
