"""Chains of salp-inspired swimming units, and one controller that steers a chain of any length.

`import salpchain` is quick: what needs JAX is imported when it is first used.
"""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

_PUBLIC = {
    "Bodies": "salpchain.physics.chain",
    "Chain": "salpchain.physics.chain",
    "Physics": "salpchain.physics.chain",
    "SCLD": "salpchain.domain.scld",
    "State": "salpchain.domain.scld",
    "TaskConfig": "salpchain.domain.config",
    "Greedy": "salpchain.control.greedy",
    "Approach": "salpchain.control.approach",
    "MPC": "salpchain.control.mpc",
    "Policy": "salpchain.control.policy",
    "load": "salpchain.control.named",
    "save_policy": "salpchain.control.storage",
    "TrainConfig": "salpchain.training.config",
    "train": "salpchain.training.trainer",
    "resume": "salpchain.training.trainer",
    "evaluate": "salpchain.evaluation.evaluate",
    "Trajectory": "salpchain.evaluation.trajectory",
    "record": "salpchain.evaluation.recording",
    "InputError": "salpchain.errors",
}

__all__ = list(_PUBLIC)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module 'salpchain' has no attribute {name!r}")
    return getattr(import_module(_PUBLIC[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
