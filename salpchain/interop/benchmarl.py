"""SCLD as a task of BenchMARL, played in VMAS."""

from collections.abc import Callable
from typing import Any

from salpchain.interop.checks import limit_of, task_of
from salpchain.interop.extras import need

for package in ("torch", "vmas", "tensordict", "torchrl", "benchmarl"):
    need(package, "benchmarl")

from benchmarl.environments.vmas.common import VmasClass
from torchrl.envs import EnvBase

from salpchain.interop.torch_world import vmas_world
from salpchain.interop.vmas import make_torchrl_env
from salpchain.world.config import WorldConfig


class SCLDTask(VmasClass):
    """BenchMARL's VMAS task with our scenario; `benchmarl_task` makes it."""

    def get_env_fun(
        self, num_envs: int, continuous_actions: bool, seed: int | None, device: Any
    ) -> Callable[[], EnvBase]:
        """What makes the environment."""
        config = dict(self.config)
        return lambda: make_torchrl_env(
            num_envs,
            device=device,
            seed=seed,
            continuous_actions=continuous_actions,
            **config,
        )


def benchmarl_task(
    max_steps: int | None = None, world: WorldConfig | str | None = None, **settings: Any
) -> SCLDTask:
    """The task with any setting of `TaskConfig`, truncated at its own limit or at `max_steps`.

    Raises:
        InputError: an unknown setting, an invalid one, or a world that VMAS cannot have.
    """
    steps = limit_of(task_of(settings), max_steps)
    config = {**settings, "max_steps": steps, "world": vmas_world(world)}
    return SCLDTask(name="SCLD", config=config)
