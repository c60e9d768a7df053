"""Chains of salp-inspired swimming units, and one controller that steers a chain of any length.

`import salpchain` is quick: what needs JAX is imported when it is first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from salpchain import forks as forks  # watches for forks from the first import on

__version__ = "0.1.0"

_PUBLIC = {
    "Bodies": "salpchain.physics.state",
    "Chain": "salpchain.physics.state",
    "Physics": "salpchain.physics.state",
    "SCLD": "salpchain.tasks.reach.task",
    "State": "salpchain.tasks.state",
    "TaskConfig": "salpchain.tasks.config",
    "Greedy": "salpchain.controllers.greedy",
    "Approach": "salpchain.controllers.approach",
    "MPC": "salpchain.controllers.mpc",
    "Controller": "salpchain.controllers.policy",
    "Policy": "salpchain.controllers.policy",
    "load": "salpchain.controllers.named",
    "steering": "salpchain.controllers.steering",
    "identity": "salpchain.controllers.identity",
    "save_policy": "salpchain.controllers.storage",
    "ControlConfig": "salpchain.networks.config",
    "PPOConfig": "salpchain.training.config",
    "Mix": "salpchain.training.config",
    "TrainConfig": "salpchain.training.config",
    "preset": "salpchain.training.settings",
    "Learner": "salpchain.training.loop",
    "new_learner": "salpchain.training.loop",
    "iterate": "salpchain.training.loop",
    "train": "salpchain.training.trainer",
    "resume": "salpchain.training.trainer",
    "evaluate": "salpchain.evaluation.evaluate",
    "Trajectory": "salpchain.evaluation.trajectory",
    "record": "salpchain.evaluation.recording",
    "InputError": "salpchain.errors",
    "use_cache": "salpchain.compilation_cache",
}

__all__ = list(_PUBLIC)  # pyright: ignore[reportUnsupportedDunderAll]

if TYPE_CHECKING:  # the same names, where editors and type checkers look for them
    from salpchain.compilation_cache import use_cache as use_cache
    from salpchain.controllers.approach import Approach as Approach
    from salpchain.controllers.greedy import Greedy as Greedy
    from salpchain.controllers.identity import identity as identity
    from salpchain.controllers.mpc import MPC as MPC
    from salpchain.controllers.named import load as load
    from salpchain.controllers.policy import Controller as Controller
    from salpchain.controllers.policy import Policy as Policy
    from salpchain.controllers.steering import steering as steering
    from salpchain.controllers.storage import save_policy as save_policy
    from salpchain.errors import InputError as InputError
    from salpchain.evaluation.evaluate import evaluate as evaluate
    from salpchain.evaluation.recording import record as record
    from salpchain.evaluation.trajectory import Trajectory as Trajectory
    from salpchain.networks.config import ControlConfig as ControlConfig
    from salpchain.physics.state import Bodies as Bodies
    from salpchain.physics.state import Chain as Chain
    from salpchain.physics.state import Physics as Physics
    from salpchain.tasks.config import TaskConfig as TaskConfig
    from salpchain.tasks.reach.task import SCLD as SCLD
    from salpchain.tasks.state import State as State
    from salpchain.training.config import Mix as Mix
    from salpchain.training.config import PPOConfig as PPOConfig
    from salpchain.training.config import TrainConfig as TrainConfig
    from salpchain.training.loop import Learner as Learner
    from salpchain.training.loop import iterate as iterate
    from salpchain.training.loop import new_learner as new_learner
    from salpchain.training.settings import preset as preset
    from salpchain.training.trainer import resume as resume
    from salpchain.training.trainer import train as train
else:

    def __getattr__(name: str) -> object:
        if name not in _PUBLIC:
            raise AttributeError(f"module 'salpchain' has no attribute {name!r}")
        return getattr(import_module(_PUBLIC[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
