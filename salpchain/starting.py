"""Whether JAX can compute in this process; if not, why, in one line."""

import os
import re

from salpchain.errors import InputError
from salpchain.forks import check_not_forked, jax_started

PLATFORMS = ("JAX_PLATFORMS", "JAX_PLATFORM_NAME")


def check_can_compute() -> None:
    """Start JAX, where nobody has yet; raise InputError if it cannot compute in this process.

    Raises:
        InputError: the accelerator that was asked for is missing, or the process was forked after
            JAX had started.
    """
    check_not_forked()
    if jax_started():
        return
    import jax

    try:
        jax.devices()
    except (AssertionError, RuntimeError) as error:  # the former where it lacks the plugin
        raise InputError(advice(" ".join(str(error).split()))) from None


def advice(reason: str) -> str:
    """What JAX says of its failed start, and what to do."""
    for name in PLATFORMS:
        if asked := os.environ.get(name):
            what = re.sub(r"\.? \(set JAX_PLATFORMS=.*?\)", "", reason) or "there is none here"
            return f"JAX cannot start with {name}={asked}: {what} (unset {name}, or {name}=cpu)"
    return f"JAX cannot start: {reason}"
