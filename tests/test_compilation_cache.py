"""Compiled programs outlive their process, and nothing about keeping them stops a command."""

import os
import subprocess
import sys

import pytest

from salpchain import compilation_cache
from salpchain.errors import InputError

# Compiles one program of its own; says how often JAX found one that was kept, and the folder.
PROGRAM = """
import salpchain
folder = salpchain.use_cache()
import jax
hits = []
jax.monitoring.register_event_listener(lambda event, **_: hits.append("cache_hits" in event))
print(jax.jit(lambda x: jax.numpy.sin(x) * 3 + x)(0.0), sum(hits), folder)
"""


def environment(**more):
    """Of a user who has set nothing about caches but what is given."""
    odd = ("JAX_", "SALPCHAIN_", "XDG_")
    return {k: v for k, v in os.environ.items() if not k.startswith(odd)} | more


def start(program, **more):
    command = [sys.executable, "-c", program]
    return subprocess.Popen(
        command, env=environment(**more), text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )


def finish(process):
    """Value, programs found and folder; nothing may be printed beside them."""
    out, said = process.communicate(timeout=120)
    assert process.returncode == 0 and said == ""
    value, hits, folder = out.split()
    return float(value), int(hits), folder


def files(folder):
    return {path.name: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_second_process_finds_what_the_first_compiled(tmp_path):
    value, hits, folder = finish(start(PROGRAM, XDG_CACHE_HOME=str(tmp_path)))
    assert (hits, files(tmp_path) != {}) == (0, True)
    assert folder.startswith(str(tmp_path / "salpchain"))
    again = finish(start(PROGRAM, XDG_CACHE_HOME=str(tmp_path)))
    assert again[0] == value and again[1] > 0


def test_entries_cut_short_by_a_killed_process_are_written_again(tmp_path):
    finish(start(PROGRAM, XDG_CACHE_HOME=str(tmp_path)))
    whole = files(tmp_path)
    for path in tmp_path.rglob("*-cache"):
        path.write_bytes(path.read_bytes()[:100])
    assert finish(start(PROGRAM, XDG_CACHE_HOME=str(tmp_path)))[1] == 0
    assert {name: len(content) > 100 for name, content in files(tmp_path).items()} == dict.fromkeys(
        whole, True
    )
    assert finish(start(PROGRAM, XDG_CACHE_HOME=str(tmp_path)))[1] > 0


def test_two_processes_may_fill_one_cache_at_once(tmp_path):
    both = [start(PROGRAM, XDG_CACHE_HOME=str(tmp_path)) for _ in range(2)]
    values = [finish(process)[0] for process in both]
    assert values[0] == values[1]
    assert finish(start(PROGRAM, XDG_CACHE_HOME=str(tmp_path)))[1] > 0


@pytest.mark.parametrize(
    "given", [{"HOME": "/proc/nowhere"}, {"SALPCHAIN_CACHE": "off"}], ids=["no home", "off"]
)
def test_without_a_cache_all_works_and_nothing_is_written(given, tmp_path):
    _, hits, folder = finish(start(PROGRAM, **{"HOME": str(tmp_path), **given}))
    assert (hits, folder, files(tmp_path)) == (0, "None", {})


def test_a_folder_that_the_user_gave_to_jax_is_the_one_used(tmp_path):
    chosen = {"HOME": str(tmp_path / "home"), "JAX_COMPILATION_CACHE_DIR": str(tmp_path / "mine")}
    assert finish(start(PROGRAM, **chosen))[2] == "None"
    assert not (tmp_path / "home").exists()


def test_the_command_line_keeps_its_programs_by_itself(tmp_path):
    out = str(tmp_path / "swim.npz")
    command = [sys.executable, "-m", "salpchain", "rollout", "greedy", "--length", "2"]
    home = tmp_path / "home"
    done = subprocess.run(
        [*command, "--out", out], env=environment(SALPCHAIN_CACHE=str(home)), check=True,
        capture_output=True, text=True,
    )  # fmt: skip
    assert any(home.rglob("jit__play*")) and "warn" not in done.stderr.lower()


def test_a_switch_that_means_nothing_is_refused(monkeypatch):
    monkeypatch.setenv("SALPCHAIN_CACHE", "of")
    with pytest.raises(InputError, match="SALPCHAIN_CACHE must be on, off or an absolute folder"):
        compilation_cache.use_cache()


@pytest.mark.parametrize("name", ["__version__", "version", "processor", "instructions"])
def test_programs_of_another_version_or_processor_are_kept_apart(name, monkeypatch):
    before = compilation_cache._key()
    other = "9.9" if name == "__version__" else lambda *_: "9.9"
    monkeypatch.setattr(compilation_cache, name, other)
    assert compilation_cache._key() != before


def test_what_was_not_used_for_the_longest_time_goes_first(tmp_path):
    for age in range(5):
        path = tmp_path / "version" / f"{age}"
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(b"x" * 100)
        os.utime(path, (1e9 - age, 1e9 - age))
    compilation_cache._prune(tmp_path, 300)
    assert set(files(tmp_path)) == {"0", "1", "2"}


@pytest.mark.skipif(os.getuid() != 0, reason="only root can give a folder away")
def test_a_folder_of_someone_else_is_not_used(tmp_path):
    os.chown(tmp_path, 12345, 12345)
    assert finish(start(PROGRAM, SALPCHAIN_CACHE=str(tmp_path)))[2] == "None"
