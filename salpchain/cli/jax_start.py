"""Why JAX does not start here, in one line: an accelerator that is missing, a wrong variable."""

import os
import re
import subprocess
import sys

from salpchain.errors import InputError
from salpchain.starting import advice

XLA = "XLA_FLAGS"
# Enough to have XLA read its flags; where one is wrong it ends the process.
_READ_FLAGS = "from jaxlib import xla_client; xla_client.CompileOptions()"
_REFUSED = 3
_START = f"""
import sys
try:
    import jax
    jax.devices()
except Exception as error:
    print(error)
    sys.exit({_REFUSED})
"""
_FATAL = re.compile(r"^F\d{4} [^\]]*parse_flags_from_env[^\]]*\] (.*)$", re.MULTILINE)


def check_flags() -> None:
    """Raise InputError if XLA would end the process over what the user has in `XLA_FLAGS`.

    Asked in a process of its own, which takes some tenths of a second, and only where it is set.
    """
    if not os.environ.get(XLA):
        return
    asked = subprocess.run(
        [sys.executable, "-c", _READ_FLAGS], capture_output=True, text=True, check=False
    )
    if asked.returncode and (said := _FATAL.search(asked.stderr)):
        raise InputError(f"{said[1].strip()} (correct or unset {XLA})")


def why_it_fails() -> str | None:
    """What keeps JAX from starting, and what to do; None if it starts.

    Asked in a process of its own: after a failed import another fails for another reason.
    """
    asked = subprocess.run(
        [sys.executable, "-c", _START], capture_output=True, text=True, check=False
    )
    return advice(" ".join(asked.stdout.split())) if asked.returncode == _REFUSED else None
