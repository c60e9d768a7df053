"""Optional packages, imported when a bridge is first used."""

from importlib import import_module
from types import ModuleType

from salpchain.errors import InputError


def need(module: str, extra: str) -> ModuleType:
    """The optional module, imported.

    Args:
        module: its full name, e.g. `torchrl.envs`.
        extra: of salpchain, the one that installs it.

    Raises:
        InputError: it is not installed; the message holds the command that installs it.
    """
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        package = module.split(".")[0]
        if (error.name or "").split(".")[0] != package:  # installed, and broken in itself
            raise
        raise InputError(
            f"{package} is not installed: run pip install 'salpchain[{extra}]'"
        ) from None
