"""Settings of a training run. Imports nothing heavy: the command line's help reads it."""

from dataclasses import dataclass, field

from salpchain.control.config import SINGLE_LENGTH, ControlConfig
from salpchain.domain.config import TaskConfig, check_seed
from salpchain.errors import InputError

MOST_STEPS = 10**10  # of a run: gradient steps are counted in 32 bits


@dataclass(frozen=True)
class PPOConfig:
    """Proximal policy optimisation (Schulman et al. 2017) on many chains at once.

    Raises:
        InputError: a number out of range, or sizes that do not divide.
    """

    envs: int = 256  # chains that swim at once
    rollout: int = 32  # control steps of each between two updates
    minibatch: int = 512  # chain-steps in one gradient step
    epochs: int = 1  # passes over a rollout
    learning_rate: float = 2e-3  # of Adam
    final_rate: float = 0.1  # share of the learning rate left at the end, linear in between
    clip: float = 0.2
    max_grad_norm: float = 0.5
    gamma: float = 0.99
    lam: float = 0.95
    entropy: float = 0.0
    value_weight: float = 0.5

    def __post_init__(self) -> None:
        for name in ("envs", "rollout", "minibatch", "epochs", "learning_rate", "max_grad_norm"):
            if not getattr(self, name) > 0:
                raise InputError(f"{name} must be positive, got {getattr(self, name)}")
        for name in ("gamma", "lam", "clip", "final_rate"):
            if not 0 <= getattr(self, name) <= 1:
                raise InputError(f"{name} must lie in [0, 1], got {getattr(self, name)}")
        if self.batch % self.minibatch:
            raise InputError(
                f"minibatch must divide envs x rollout = {self.batch}, got {self.minibatch}"
            )

    @property
    def batch(self) -> int:
        """Chain-steps between two updates."""
        return self.envs * self.rollout

    @property
    def minibatches(self) -> int:
        """Gradient steps in one epoch."""
        return self.batch // self.minibatch


@dataclass(frozen=True)
class TrainConfig:
    """One training run, whole.

    Raises:
        InputError: a number of steps or a seed that cannot be.
    """

    task: TaskConfig = field(default_factory=TaskConfig)
    control: ControlConfig = field(default_factory=ControlConfig)
    ppo: PPOConfig = field(default_factory=PPOConfig)
    preset: str = "quick"
    steps: int = 1_500_000  # chain-steps in all, rounded up to whole rollouts
    seed: int = 0

    def __post_init__(self) -> None:
        if not 1 <= self.steps <= MOST_STEPS:
            raise InputError(f"steps must be positive, at most {MOST_STEPS:,}, got {self.steps}")
        check_seed(self.seed)

    @property
    def name(self) -> str:
        """Of the policy: model, graph (where the model has one) and training length."""
        control = self.control
        graph = "" if control.model in SINGLE_LENGTH else f"-{control.graph}"
        return f"{control.model}{graph}-{self.task.length}"

    @property
    def iterations(self) -> int:
        """Rollouts with their updates."""
        return -(-self.steps // self.ppo.batch)

    @property
    def total_steps(self) -> int:
        """Chain-steps of all iterations: `steps` rounded up to whole rollouts."""
        return self.iterations * self.ppo.batch
