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
    "World": "salpchain.world.world",
    "WorldConfig": "salpchain.world.config",
    "DynamicsConfig": "salpchain.world.config",
    "CurrentConfig": "salpchain.world.config",
    "ThrusterConfig": "salpchain.world.config",
    "SensingConfig": "salpchain.world.config",
    "ObstacleConfig": "salpchain.world.config",
    "Range": "salpchain.ranges",
    "Task": "salpchain.tasks.task",
    "SCLD": "salpchain.tasks.reach.task",
    "make_task": "salpchain.tasks.registry",
    "renew_done": "salpchain.tasks.renew",
    "TaskConfig": "salpchain.tasks.config",
    "FollowConfig": "salpchain.tasks.follow.config",
    "State": "salpchain.tasks.state",
    "Start": "salpchain.tasks.state",
    "Judgement": "salpchain.tasks.state",
    "OBSERVATIONS": "salpchain.tasks.features",
    "Feature": "salpchain.tasks.features",
    "scalar_feature": "salpchain.tasks.features",
    "vector_feature": "salpchain.tasks.features",
    "Greedy": "salpchain.controllers.greedy",
    "Approach": "salpchain.controllers.approach",
    "MPC": "salpchain.controllers.mpc",
    "Controller": "salpchain.controllers.policy",
    "Policy": "salpchain.controllers.policy",
    "PolicyCard": "salpchain.controllers.policy",
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
    "run_suite": "salpchain.evaluation.suite",
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
    from salpchain.controllers.policy import PolicyCard as PolicyCard
    from salpchain.controllers.steering import steering as steering
    from salpchain.controllers.storage import save_policy as save_policy
    from salpchain.errors import InputError as InputError
    from salpchain.evaluation.evaluate import evaluate as evaluate
    from salpchain.evaluation.recording import record as record
    from salpchain.evaluation.suite import run_suite as run_suite
    from salpchain.evaluation.trajectory import Trajectory as Trajectory
    from salpchain.networks.config import ControlConfig as ControlConfig
    from salpchain.physics.state import Bodies as Bodies
    from salpchain.physics.state import Chain as Chain
    from salpchain.physics.state import Physics as Physics
    from salpchain.ranges import Range as Range
    from salpchain.tasks.config import TaskConfig as TaskConfig
    from salpchain.tasks.features import OBSERVATIONS as OBSERVATIONS
    from salpchain.tasks.features import Feature as Feature
    from salpchain.tasks.features import scalar_feature as scalar_feature
    from salpchain.tasks.features import vector_feature as vector_feature
    from salpchain.tasks.follow.config import FollowConfig as FollowConfig
    from salpchain.tasks.reach.task import SCLD as SCLD
    from salpchain.tasks.registry import make_task as make_task
    from salpchain.tasks.renew import renew_done as renew_done
    from salpchain.tasks.state import Judgement as Judgement
    from salpchain.tasks.state import Start as Start
    from salpchain.tasks.state import State as State
    from salpchain.tasks.task import Task as Task
    from salpchain.training.config import Mix as Mix
    from salpchain.training.config import PPOConfig as PPOConfig
    from salpchain.training.config import TrainConfig as TrainConfig
    from salpchain.training.loop import Learner as Learner
    from salpchain.training.loop import iterate as iterate
    from salpchain.training.loop import new_learner as new_learner
    from salpchain.training.settings import preset as preset
    from salpchain.training.trainer import resume as resume
    from salpchain.training.trainer import train as train
    from salpchain.world.config import CurrentConfig as CurrentConfig
    from salpchain.world.config import DynamicsConfig as DynamicsConfig
    from salpchain.world.config import ObstacleConfig as ObstacleConfig
    from salpchain.world.config import SensingConfig as SensingConfig
    from salpchain.world.config import ThrusterConfig as ThrusterConfig
    from salpchain.world.config import WorldConfig as WorldConfig
    from salpchain.world.world import World as World
else:

    def __getattr__(name: str) -> object:
        if name not in _PUBLIC:
            raise AttributeError(f"module 'salpchain' has no attribute {name!r}")
        return getattr(import_module(_PUBLIC[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
