"""One run over several devices, several seeds on one: the results are those of one by one."""

import csv
import dataclasses
import json
import subprocess
import sys
from pathlib import Path

import equinox as eqx
import jax
import numpy as np
import pytest

from salpchain.controllers.storage import load
from salpchain.devices import largest_divisor
from salpchain.machine import cores
from salpchain.training import trainer
from salpchain.training.checkpoint import CHECKPOINT_FILE
from salpchain.training.metrics import NotFiniteError
from salpchain.training.trainer import train, train_together
from tests.training.small import small

ITERATIONS = 4
SEEDS = [dataclasses.replace(small(ITERATIONS), seed=seed) for seed in (0, 1)]


@pytest.mark.slow
def test_four_devices_learn_what_one_does_up_to_the_order_of_sums():
    command = [sys.executable, "-m", "tests.training.shared"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=400)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["learned"] > 0.1
    assert found["apart"] < 1e-8 * found["learned"]  # other minibatches: about as much as learned


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="threads are counted on Linux")
@pytest.mark.skipif(cores() < 2, reason="needs two cores")
def test_fewer_devices_than_cores_share_as_many_threads():
    count = (
        "from pathlib import Path; from salpchain.devices import use_devices; use_devices(1);"
        "import jax; jax.jit(lambda x: x @ x)(jax.numpy.ones((500, 500))).block_until_ready();"
        "names = [x.read_text() for x in Path('/proc/self/task').glob('*/comm')];"
        "print(sum('XLAEigen' in name for name in names))"
    )
    done = subprocess.run([sys.executable, "-c", count], capture_output=True, text=True)
    assert done.stdout.strip() == "1", done.stderr


def rows(run):
    return list(csv.DictReader((run / "metrics.csv").open()))


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    folder = tmp_path_factory.mktemp("alone")
    for config in SEEDS:
        train(config, folder / str(config.seed), devices=1)
    return folder


def folders(place):
    return [place / str(config.seed) for config in SEEDS]


@pytest.mark.slow
def test_seeds_side_by_side_learn_what_each_does_alone(alone, tmp_path):
    train_together(SEEDS, folders(tmp_path), devices=1)
    for own, other in zip(folders(tmp_path), folders(alone), strict=True):
        assert (own / "summary.json").exists()
        assert [row["iteration"] for row in rows(own)] == ["1", "2", "3", "4"]
        ours, theirs = (float(rows(run)[0]["reward_approach"]) for run in (own, other))
        assert ours == pytest.approx(theirs, rel=0.05)
        weights = [jax.tree.leaves(load(run).network) for run in (own, other)]
        assert max(float(np.abs(a - b).max()) for a, b in zip(*weights, strict=True)) < 2e-2
    one, two = ((run / "policy.safetensors").read_bytes() for run in folders(tmp_path))
    assert one != two


@pytest.mark.slow
def test_seeds_that_were_stopped_at_different_iterations_all_come_to_their_end(alone, tmp_path):
    def stop(metrics, step):
        if step >= 2 * SEEDS[0].ppo.batch:
            raise ValueError("that will do")

    with pytest.raises(ValueError, match="that will do") as stopped:
        train(SEEDS[0], tmp_path / "0", on_iteration=stop, devices=1)
    (said,) = stopped.value.__notes__
    assert "step 256; salpchain.resume(" in said and len(rows(tmp_path / "0")) == 2
    train_together(SEEDS, folders(tmp_path), devices=1)
    kept = (tmp_path / "0" / CHECKPOINT_FILE).read_bytes()
    assert kept == (alone / "0" / CHECKPOINT_FILE).read_bytes()
    assert [len(rows(run)) for run in folders(tmp_path)] == [ITERATIONS] * 2


@pytest.mark.slow
def test_a_seed_that_breaks_stops_nothing_but_itself(tmp_path, monkeypatch):
    compile_iterate = trainer.compile_iterate

    def breaking(*args):
        step = compile_iterate(*args)

        def iterate(learner):
            learner, metrics = step(learner)
            fine = np.array(metrics.finite.losses)
            fine[1] = False
            return learner, eqx.tree_at(lambda x: x.finite.losses, metrics, fine)

        return iterate

    monkeypatch.setattr(trainer, "compile_iterate", breaking)
    with pytest.raises(NotFiniteError, match="not a finite number in the losses"):
        train_together(SEEDS, folders(tmp_path), devices=1)
    good, bad = folders(tmp_path)
    assert (good / "summary.json").exists() and len(rows(good)) == ITERATIONS
    assert not (bad / "summary.json").exists() and not (bad / "policy.safetensors").exists()


@pytest.mark.parametrize(
    ("number", "most", "found"), [(256, 2, 2), (10, 4, 2), (7, 3, 1), (6, 9, 6)]
)
def test_chains_are_shared_out_evenly(number, most, found):
    assert largest_divisor(number, most) == found
