"""Devices that share out the chains of one run."""

import contextlib
import os
from collections.abc import Iterator

import jax
from jax.sharding import AxisType, Mesh

from salpchain.errors import InputError
from salpchain.forks import check_not_forked
from salpchain.given import whole
from salpchain.machine import cores, processor
from salpchain.starting import check_can_compute

AXIS = "devices"  # the mesh axis over which chains are shared out
LOOP_OPTION = "xla_cpu_small_while_loop_byte_threshold"
LOOP_BYTES = 10_000_000  # touched in one turn of a loop that becomes one function (chosen)
THREADS = "NPROC"  # the environment's word to XLA for how many threads a CPU's devices share


def use_devices(count: int | None = None, or_fewer: bool = False) -> int:
    """Makes `count` devices ready, `or_fewer`, and returns how many there are to be used.

    On a CPU each core becomes a device of its own (several times faster than one device with many
    threads), and XLA is let compile the substep loop of the physics as one function, which it
    otherwise does for loops over little memory alone (the environment is faster by a third). Fewer
    devices than cores share as many threads as they are, so that runs side by side do not split
    their work over each other's cores (each 1.5 times as fast, measured). On a GPU matrix products
    are taken in full float32. Must come before JAX's first computation; later, the devices that are
    there are used as they are.

    Raises:
        InputError: no such number of devices, fewer than asked for, or a process that was
            forked after JAX had started.
    """
    check_not_forked()
    count = None if count is None else whole("devices", count, least=1)
    if LOOP_OPTION not in os.environ.get("XLA_FLAGS", ""):
        flag = f"--xla_backend_extra_options={LOOP_OPTION}={LOOP_BYTES}"
        os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {flag}".strip()
    with contextlib.suppress(RuntimeError):  # JAX has started: its devices are what they are
        jax.config.update("jax_num_cpu_devices", count or cores())
    with _threads(count or cores()):
        check_can_compute()
        there = jax.local_device_count()
    if jax.default_backend() != "cpu":
        jax.config.update("jax_default_matmul_precision", "highest")
    if count is not None and there < count and not or_fewer:
        are = f"{there} is" if there == 1 else f"{there} are"
        raise InputError(f"{count} devices were asked for, but {are} there: {_remedy(count)}")
    return min(count or there, there)


@contextlib.contextmanager
def _threads(count: int) -> Iterator[None]:
    """Within, JAX starts with no more than so many threads for its CPU devices."""
    ours = count < cores() and THREADS not in os.environ
    if ours:
        os.environ[THREADS] = str(count)
    try:
        yield
    finally:
        if ours:
            del os.environ[THREADS]


def _remedy(count: int) -> str:
    """How there would be so many devices."""
    if jax.default_backend() != "cpu":
        return "give as many as there are, or leave devices out"
    return (
        f'jax.config.update("jax_num_cpu_devices", {count}) before the first computation makes as'
        f" many of a CPU, and so does JAX_NUM_CPU_DEVICES={count} in the environment"
    )


def largest_divisor(number: int, most: int) -> int:
    """The largest number up to `most` that divides this one."""
    return max(n for n in range(1, min(number, most) + 1) if number % n == 0)


def mesh_of(devices: int) -> Mesh:
    """A mesh over the first `devices` devices."""
    return jax.make_mesh((devices,), (AXIS,), (AxisType.Auto,), devices=jax.devices()[:devices])


def device_name() -> str:
    """What the first device calls itself, such as "cpu (AMD EPYC 9005)"."""
    backend, kind = jax.default_backend(), jax.devices()[0].device_kind
    return f"{backend} ({processor() if backend == 'cpu' else kind})"
