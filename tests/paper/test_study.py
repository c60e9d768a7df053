"""Whole studies, small: killed or shared out, they end with the same policies and one report."""

import os
import shutil
import signal
import subprocess
import sys
import time

import pytest

from salpchain.errors import InputError
from salpchain.experiments.sweep import sweep
from salpchain.paper.grid import Grid, claim
from salpchain.paper.jobs import jobs_of
from salpchain.paper.results import run_of

OPTIONS = {
    "models": "mlp", "lengths": "2", "seeds": "2", "steps": "160000", "trials": "2", "tests": "2",
}  # fmt: skip
GRID = Grid(models=("mlp",), graphs=(), lengths=(2,), seeds=2, steps=160_000, trials=2, tests=(2,))


def words(folder, **changed):
    options = {**OPTIONS, **changed}
    given = [word for name, value in options.items() for word in (f"--{name}", value)]
    command = [sys.executable, "-m", "salpchain.cli.main", "reproduce", "--out", str(folder)]
    return [*command, *given]


def reproduce(folder, **changed):
    done = subprocess.run(words(folder, **changed), capture_output=True, text=True, timeout=600)
    return done.returncode, done.stdout + done.stderr


def policies(folder):
    return [(run_of(folder, j) / "policy.safetensors").read_bytes() for j in GRID.jobs()]


def rows(folder, job):
    path = run_of(folder, job) / "metrics.csv"
    return path.read_text().count("\n") if path.exists() else 0


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    """Of compiled programs, for all studies of this file; that of all tests where there is one."""
    if "JAX_COMPILATION_CACHE_DIR" in os.environ:
        yield
        return
    os.environ["JAX_COMPILATION_CACHE_DIR"] = str(tmp_path_factory.mktemp("cache"))
    yield
    del os.environ["JAX_COMPILATION_CACHE_DIR"]


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory, cache):
    folder = tmp_path_factory.mktemp("studies") / "undisturbed"
    status, said = reproduce(folder, jobs="1")
    assert status == 0, said
    return folder


@pytest.mark.slow
def test_a_study_leaves_every_run_its_tests_figures_and_a_report(undisturbed):
    for job in GRID.jobs():
        for name in ("summary.json", "fixed/evaluation.json", "scaled/evaluation.csv"):
            assert (run_of(undisturbed, job) / name).stat().st_size > 0
    report = undisturbed / "report"
    names = {path.name for path in report.iterdir()}
    assert {"report.md", "report.html", "study.json", "training.csv", "figure-3.png"} <= names
    page = (report / "report.html").read_text()
    assert "data:image/png;base64," in page and 'src="figure' not in page
    assert "all 2 runs are whole" in (report / "report.md").read_text()


@pytest.mark.slow
def test_a_whole_study_is_not_done_again(undisturbed):
    before = {path: path.stat().st_mtime_ns for path in (undisturbed / "runs").rglob("*")}
    assert reproduce(undisturbed, jobs="1")[0] == 0
    after = {path: path.stat().st_mtime_ns for path in (undisturbed / "runs").rglob("*")}
    assert after == before


@pytest.mark.slow
def test_a_study_that_was_killed_goes_on_and_ends_with_the_same_policies(undisturbed, tmp_path):
    folder = tmp_path / "killed"
    first, second = GRID.jobs()
    process = subprocess.Popen(words(folder, jobs="1"), stdout=subprocess.DEVNULL)
    while process.poll() is None and rows(folder, second) < 4:
        time.sleep(0.05)
    process.send_signal(signal.SIGKILL)
    process.wait()
    whole = (run_of(folder, first) / "summary.json").stat().st_mtime_ns
    assert not (run_of(folder, second) / "summary.json").exists()
    status, said = reproduce(folder, jobs="1")
    assert status == 0, said
    assert (run_of(folder, first) / "summary.json").stat().st_mtime_ns == whole
    assert policies(folder) == policies(undisturbed)


@pytest.mark.slow
def test_a_damaged_result_is_named_and_set_aside_then_done_again(undisturbed, tmp_path):
    folder = tmp_path / "damaged"
    shutil.copytree(undisturbed, folder)
    harmed = [run_of(folder, job) / "fixed" / "evaluation.json" for job in GRID.jobs()[:2]]
    for path in harmed:
        path.write_text(path.read_text()[:-30])
    status, said = reproduce(folder, jobs="1")
    assert status == 2 and said.count("\n") == 2
    for path, line in zip(harmed, said.splitlines(), strict=True):
        assert str(path) in line and "fixed.damaged" in line
    status, said = reproduce(folder, jobs="1")
    assert status == 0, said
    mended, meant = (x / "report" / "zero-shot-fixed.csv" for x in (folder, undisturbed))
    assert mended.read_text() == meant.read_text()


@pytest.mark.slow
def test_another_grid_is_refused_in_one_line(undisturbed):
    status, said = reproduce(undisturbed, trials="3")
    assert status == 2 and said.count("\n") == 1 and "another grid: trials 2 there, 3 given" in said


@pytest.mark.slow
def test_on_a_ray_cluster_that_loses_a_node_it_ends_with_the_same_policies(
    undisturbed, tmp_path, monkeypatch
):
    ray = pytest.importorskip("ray")
    from ray.cluster_utils import Cluster

    from salpchain.experiments.on_ray import RayExecutor

    folder = tmp_path / "ray"
    claim(folder, GRID)
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 0})
    nodes = [cluster.add_node(num_cpus=2) for _ in range(2)]
    killed = []

    def watch(_):
        if not killed and all(rows(folder, job) >= 3 for job in GRID.jobs()):
            killed.append(nodes.pop())
            cluster.remove_node(killed[0], allow_graceful=False)

    try:
        executor = RayExecutor(cluster.address, cpus=2)
        assert sweep(jobs_of(folder, GRID), executor, watch) == []
    finally:
        ray.shutdown()
        cluster.shutdown()
    assert killed and policies(folder) == policies(undisturbed)


@pytest.mark.parametrize(
    ("address", "said"),
    [
        ("127.0.0.1:1", "no Ray cluster at 127.0.0.1:1 "),
        ("here:there", "HOST:PORT, got here:there"),
    ],
)
def test_where_no_cluster_answers_ray_does_not_wait_for_it(address, said):
    pytest.importorskip("ray")
    from salpchain.experiments.on_ray import RayExecutor

    with pytest.raises(InputError, match=said):
        RayExecutor(address)
