"""Settings of a training run. Imports nothing heavy: the command line's help reads it."""

from dataclasses import dataclass, field

from salpchain.checks import check_kinds, check_length, check_seed, one_of, set_field
from salpchain.controllers.named import check_name
from salpchain.errors import InputError
from salpchain.networks.config import SINGLE_LENGTH, ControlConfig, check_jets
from salpchain.tasks.config import TaskConfig
from salpchain.world.config import WorldConfig

MOST_STEPS = 10**10  # of a run: gradient steps are counted in 32 bits
MOST_BATCH = 10**8  # chain-steps between two updates (chosen; no machine has room for more)
WEIGHTS = (1e-6, 1e6)  # of lengths; far apart, in single precision, one would be nothing (chosen)
RATIOS = ("chain", "unit")
CREDITS = ("chain", "unit")
CUSTOM = "custom"  # the preset of settings that come from none


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
    ratio: str = "chain"  # what is clipped: the chain's probability ratio, or each unit's
    credit: str = "chain"  # what a unit's action earned: what the chain did, or its own share too
    max_grad_norm: float = 0.5
    gamma: float = 0.99
    lam: float = 0.95
    entropy: float = 0.0  # weight of a chain's entropy (nat)
    final_entropy: float = 1.0  # share of that weight left at the end, linear in between
    value_weight: float = 0.5

    def __post_init__(self) -> None:
        check_kinds(self)
        for name in ("envs", "rollout", "minibatch", "epochs", "learning_rate", "max_grad_norm"):
            if not getattr(self, name) > 0:
                raise InputError(f"{name} must be positive, got {getattr(self, name)}")
        for name in ("gamma", "lam", "clip", "final_rate", "final_entropy"):
            if not 0 <= getattr(self, name) <= 1:
                raise InputError(f"{name} must lie in [0, 1], got {getattr(self, name)}")
        for name in ("entropy", "value_weight"):
            if getattr(self, name) < 0:
                raise InputError(f"{name} must be 0 or more, got {getattr(self, name)}")
        one_of("ratio", self.ratio, RATIOS)
        one_of("credit", self.credit, CREDITS)
        if self.credit == "unit" and self.ratio != "unit":
            raise InputError(f"credit unit needs ratio unit, got ratio {self.ratio}")
        if self.batch > MOST_BATCH:
            raise InputError(f"envs x rollout must be at most {MOST_BATCH:,}, got {self.batch:,}")
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
class Mix:
    """The lengths that a run trains on at once; each episode's is drawn anew.

    With a curriculum, the run starts with the shortest, and the next longer one joins whenever all
    so far succeed in the share `grow` of their episodes. With `roughen`, it starts in still water:
    whenever that share of episodes succeeds, these are spared a twentieth less of their world.

    Raises:
        InputError: lengths out of order or twice, or invalid weights or an invalid share.
    """

    lengths: tuple[int, ...] = ()  # units, ascending; none: the task's length alone
    weights: tuple[float, ...] = ()  # how often an episode has each length; none: equally often
    grow: float = 0.0  # share of successes at which the next length joins; 0: no curriculum
    roughen: float = 0.0  # share of successes at which the worlds get rougher; 0: rough at once

    def __post_init__(self) -> None:
        for name in ("lengths", "weights"):
            if isinstance(getattr(self, name), list):
                set_field(self, name, tuple(getattr(self, name)))
        check_kinds(self)
        for length in self.lengths:
            check_length(length)
        if list(self.lengths) != sorted(set(self.lengths)):
            raise InputError(f"lengths must ascend, each once, got {list(self.lengths)}")
        if self.weights and len(self.weights) != len(self.lengths):
            raise InputError(
                f"weights must be as many as lengths, {len(self.lengths)}, got {len(self.weights)}"
            )
        least, most = WEIGHTS
        if not all(least <= weight <= most for weight in self.weights):
            given = ",".join(map(str, self.weights))
            raise InputError(f"weights must be {least:f} to {most:.0f}, got {given}")
        for name in ("grow", "roughen"):
            if not 0 <= getattr(self, name) <= 1:
                raise InputError(f"{name} must lie in [0, 1], got {getattr(self, name)}")
        if self.grow and len(self.lengths) < 2:
            raise InputError(
                f"a curriculum needs several lengths, got {len(self.lengths) or 'one'}:"
                " give a range such as 4..16"
            )


@dataclass(frozen=True)
class TrainConfig:
    """One training run, whole.

    Raises:
        InputError: an invalid number of steps, seed or name, or a controller of one
            length with several lengths.
    """

    task: TaskConfig = field(default_factory=TaskConfig)
    control: ControlConfig = field(default_factory=ControlConfig)
    ppo: PPOConfig = field(default_factory=PPOConfig)
    mix: Mix = field(default_factory=Mix)
    world: WorldConfig = field(default_factory=WorldConfig)
    preset: str = CUSTOM
    steps: int = 1_500_000  # chain-steps in all, rounded up to whole rollouts
    seed: int = 0
    evaluations: int = 0  # parts of the run, each with an evaluation at its end; 0: one
    name: str = ""  # of the policy; none: by model, graph and lengths
    start: str = ""  # a policy or a run whose weights the run begins with; none: fresh ones
    fresh_spread: bool = False  # of actions at the start; else the policy's where that is larger

    def __post_init__(self) -> None:
        check_kinds(self)
        if self.evaluations < 0:
            raise InputError(f"evaluations must be 0 or more, got {self.evaluations}")
        if not 1 <= self.steps <= MOST_STEPS:
            raise InputError(f"steps must be positive, at most {MOST_STEPS:,}, got {self.steps}")
        check_seed(self.seed)
        if self.name:
            check_name(self.name)
        if self.mix.roughen and self.world.is_still:
            raise InputError(
                f"mix.roughen needs a world that can get rougher, got {self.mix.roughen} in still"
                " water: give one such as world.name=sea"
            )
        check_jets(self.control, self.task.observation)
        if self.control.memory and self.ppo.envs % self.ppo.minibatches:
            raise InputError(
                "ppo.envs must be a multiple of the minibatches where units remember, for each"
                f" learns from whole rollouts of some chains: {self.ppo.minibatches} minibatches,"
                f" got {self.ppo.envs}"
            )
        if len(self.lengths) > 1:
            self._check_many_lengths()
        if max(self.lengths) != self.task.length:
            raise InputError(
                f"task.length must be the longest of mix.lengths, {max(self.lengths)},"
                f" got {self.task.length}"
            )

    def _check_many_lengths(self) -> None:
        if self.control.model in SINGLE_LENGTH:
            raise InputError(
                f"an {self.control.model} works at one length only, got {len(self.lengths)} lengths"
            )
        if not self.control.shared_log_std:
            raise InputError(
                f"a log-std for each unit (control.shared_log_std false, as in preset paper) serves"
                f" one length only, got {len(self.lengths)} lengths: take preset quick"
            )

    @property
    def lengths(self) -> tuple[int, ...]:
        """All lengths (units) that the run trains on, ascending."""
        return self.mix.lengths or (self.task.length,)

    @property
    def policy_name(self) -> str:
        """What the policy is called: `name`, or model, graph (if it has one) and lengths."""
        if self.name:
            return self.name
        control, lengths = self.control, self.lengths
        graph = "" if control.model in SINGLE_LENGTH else f"-{control.graph}"
        shortest = f"{lengths[0]}to" if len(lengths) > 1 else ""
        model = control.model.rpartition(":")[2]  # of one's own, by the name of its class
        return f"{model}{graph}-{shortest}{max(lengths)}"

    @property
    def iterations(self) -> int:
        """Rollouts with their updates."""
        return -(-self.steps // self.ppo.batch)

    def is_evaluated_at(self, iteration: int) -> bool:
        """Whether one of the evaluations during the run comes after this iteration.

        The closing evaluation, after the last one, is none of them.
        """
        if iteration == self.iterations:
            return False
        done, before = (x * self.evaluations // self.iterations for x in (iteration, iteration - 1))
        return done > before

    @property
    def total_steps(self) -> int:
        """Chain-steps of all iterations: `steps` rounded up to whole rollouts."""
        return self.iterations * self.ppo.batch
