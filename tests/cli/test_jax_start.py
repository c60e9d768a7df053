"""Where JAX cannot start, every command says why in one line and exits with status 2."""

import os
import subprocess
import sys

import pytest

BASE = ("JAX_PLATFORMS", "JAX_PLATFORM_NAME", "XLA_FLAGS")


def run(arguments, given):
    clean = {name: value for name, value in os.environ.items() if name not in BASE}
    return subprocess.run(
        [sys.executable, "-m", "salpchain", *arguments], env=clean | given, timeout=120,
        capture_output=True, text=True, check=False,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("JAX_PLATFORMS", "cuda", "unset JAX_PLATFORMS, or JAX_PLATFORMS=cpu"),
        ("JAX_PLATFORMS", "gpu", "unset JAX_PLATFORMS, or JAX_PLATFORMS=cpu"),
        ("JAX_PLATFORMS", "water", "'water' is not in the list of known backends"),
        ("JAX_PLATFORM_NAME", "cuda", "JAX_PLATFORM_NAME=cpu"),
        ("XLA_FLAGS", "--xla_no_such_flag=1", "--xla_no_such_flag=1 (correct or unset XLA_FLAGS)"),
        ("XLA_FLAGS", "--xla_cpu_enable_fast_math=perhaps", "correct or unset XLA_FLAGS"),
        ("XLA_FLAGS", "no-flag", "correct or unset XLA_FLAGS"),
        ("JAX_ENABLE_X64", "perhaps", "invalid truth value 'perhaps' for environment 'JAX_ENABLE"),
        ("JAX_NUM_CPU_DEVICES", "two", "jax_num_cpu_devices"),
        ("JAX_DEFAULT_DEVICE", "water", "got: 'water'"),
    ],
)
def test_a_setting_with_which_jax_cannot_start_is_one_line(name, value, said, tmp_path):
    done = run(["rollout", "greedy", "--out", str(tmp_path / "swim.npz")], {name: value})
    assert done.returncode == 2, done.stderr
    assert done.stderr.startswith("salpchain: error: ") and done.stderr.count("\n") == 1
    assert said in done.stderr and len(done.stderr) < 400
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "arguments",
    [
        ["train", "--steps", "1000", "--out", "OUT"],
        ["evaluate", "greedy", "--lengths", "2", "--trials", "2", "--out", "OUT"],
        ["live", "greedy", "--port", "0"],
        ["bench"],
        ["export", "any-length", "--format", "torch", "--out", "OUT.safetensors"],
        ["reproduce", "--out", "OUT"],
    ],
    ids=lambda arguments: arguments[0],
)
def test_no_command_meets_a_missing_accelerator_with_a_traceback(arguments, tmp_path):
    words = [word.replace("OUT", str(tmp_path / "out")) for word in arguments]
    done = run(words, {"JAX_PLATFORMS": "cuda"})
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    assert "JAX cannot start with JAX_PLATFORMS=cuda" in done.stderr.splitlines()[-1]
