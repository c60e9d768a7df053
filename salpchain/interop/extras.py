"""Optional packages, imported when a bridge is first used."""

from importlib import import_module
from types import ModuleType

from salpchain.errors import InputError
from salpchain.installation import install_command


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
        package, missing = module.split(".")[0], (error.name or "").split(".")[0]
        if error.name != missing:  # a part of something installed: broken in itself
            raise
        what = f"{missing} is" if missing == package else f"{package} needs {missing}, which is"
        raise InputError(f"{what} not installed: run {install_command(extra)}") from None
