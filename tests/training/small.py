"""A run small enough to be trained in a second, compile time apart; also run as a program."""

import sys
from pathlib import Path

from salpchain.networks.config import ControlConfig
from salpchain.tasks.config import TaskConfig
from salpchain.training.config import PPOConfig, TrainConfig


def small(iterations=12, **ppo):
    settings = {"envs": 8, "rollout": 16, "minibatch": 64, "epochs": 2, **ppo}
    return TrainConfig(
        task=TaskConfig(length=3, fine_weight=0.5, contact=False),
        control=ControlConfig(),
        ppo=PPOConfig(**settings),
        steps=iterations * settings["envs"] * settings["rollout"],
    )


if __name__ == "__main__":
    from salpchain.training.trainer import resume, train

    folder, iterations = Path(sys.argv[1]), int(sys.argv[2])
    if (folder / "config.json").exists():
        resume(folder, save_every=0.0)
    else:
        train(small(iterations), folder, save_every=0.0)
