"""SCLD as a task of BenchMARL, played in VMAS."""

from collections.abc import Callable
from typing import Any

from salpchain.domain.config import step_limit
from salpchain.interop.batch import task_of
from salpchain.interop.extras import need
from salpchain.interop.vmas import Scenario

need("benchmarl", "benchmarl")

from benchmarl.environments.vmas.common import VmasClass
from torchrl.envs import EnvBase
from torchrl.envs.libs.vmas import VmasEnv


class SCLDTask(VmasClass):
    """BenchMARL's VMAS task with our scenario; `benchmarl_task` makes it."""

    def get_env_fun(
        self, num_envs: int, continuous_actions: bool, seed: int | None, device: Any
    ) -> Callable[[], EnvBase]:
        """What makes the environment."""
        settings = dict(self.config)
        return lambda: VmasEnv(
            scenario=Scenario(),
            num_envs=num_envs,
            continuous_actions=continuous_actions,
            seed=seed,
            device=device,
            categorical_actions=True,
            clamp_actions=True,
            **settings,
        )


def benchmarl_task(max_steps: int | None = None, **settings: Any) -> SCLDTask:
    """The task with any setting of `TaskConfig`, truncated at its own limit or at `max_steps`.

    Raises:
        InputError: an unknown setting, or one that cannot be.
    """
    config = task_of(settings)
    steps = max_steps or step_limit(config.time_limit, config.length)
    return SCLDTask(name="SCLD", config={**settings, "max_steps": steps})
