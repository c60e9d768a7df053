"""SCLD in TorchRL: an `EnvBase` over a compiled batch, tensors shared through DLPack."""

from typing import Any

from salpchain.interop.batch import Batch
from salpchain.interop.checks import check_options, checked_seed, task_of
from salpchain.interop.extras import need
from salpchain.world.randomise import WorldLike

need("torch", "torchrl")
need("tensordict", "torchrl")
need("torchrl", "torchrl")

import torch
from tensordict import TensorDict, TensorDictBase
from torchrl.data import Bounded, Categorical, Composite, Unbounded
from torchrl.envs import EnvBase

from salpchain.interop.torch import checked_device, to_torch


class SalpTorchEnv(EnvBase):
    """A batch of chains: `observation` (env, unit, feature), `action` (env, unit, act).

    An episode that is over goes on until TorchRL resets it, as its collectors and rollouts do;
    a reset starts the next episode of those chains and leaves the others as they are. What the
    environment hands out shares JAX's memory: do not write into it.
    """

    def __init__(
        self, num_envs: int = 1, device: str = "cpu", world: WorldLike = None, **settings: Any
    ) -> None:
        """`num_envs` chains with any setting of `TaskConfig`, in a world as `SCLD` takes.

        Raises:
            InputError: an unknown setting, an invalid one, or no world.
        """
        batch = Batch(task_of(settings), num_envs, renew=False, world=world)
        device = checked_device(device)
        super().__init__(device=device, batch_size=torch.Size([num_envs]))
        self.config, self._batch = batch.config, batch
        self._seed: int | None = None
        chains, one = torch.Size([num_envs]), torch.Size([num_envs, 1])
        seen = torch.Size([num_envs, *self._batch.observation_shape])
        done = torch.Size([num_envs, *self._batch.action_shape])
        flags = [Categorical(2, shape=one, dtype=torch.bool) for _ in range(4)]
        self.observation_spec = Composite(
            observation=Unbounded(shape=seen),
            goal=flags[0],
            closed_fraction=Unbounded(shape=one),
            shape=chains,
        )
        self.action_spec = Bounded(-1.0, 1.0, shape=done, dtype=torch.float32)
        self.reward_spec = Unbounded(shape=one)
        self.done_spec = Composite(
            done=flags[1], terminated=flags[2], truncated=flags[3], shape=chains
        )
        self.to(device)

    def set_seed(self, seed: int | None = None, static_seed: bool = False) -> int | None:
        """The next reset of all chains starts the episodes of seed, seed + 1, ...

        Raises:
            InputError: no whole number from 0 on.
        """
        return super().set_seed(None if seed is None else checked_seed(seed), static_seed)

    def _set_seed(self, seed: int | None) -> None:
        self._seed = seed

    def _reset(self, tensordict: TensorDictBase | None = None, **options: Any) -> TensorDict:
        """New episodes of all chains, or of those alone that `_reset` flags.

        Raises:
            InputError: an option, of which there are none; flags before the first reset of all.
        """
        check_options(options, ())
        which = None if tensordict is None else tensordict.get("_reset", None)
        if which is None or bool(which.all()):
            self._batch.reset(self._seed)
            self._seed = None
        else:
            self._batch.reset_some(which.reshape(-1).cpu().numpy())
        states = self._batch.started()
        no = torch.zeros(self._batch.num_envs, dtype=torch.bool)
        return self._record(
            observation=to_torch(states.obs),
            goal=to_torch(states.goal),
            closed_fraction=to_torch(states.closed_fraction),
            done=no,
            terminated=no.clone(),
            truncated=no.clone(),
        )

    def _step(self, tensordict: TensorDictBase) -> TensorDict:
        outcome = self._batch.step(tensordict["action"].detach().cpu().numpy())
        terminated, truncated = to_torch(outcome.terminated), to_torch(outcome.truncated)
        return self._record(
            observation=to_torch(outcome.obs),
            reward=to_torch(outcome.reward),
            goal=to_torch(outcome.goal),
            closed_fraction=to_torch(outcome.closed_fraction),
            done=terminated | truncated,
            terminated=terminated,
            truncated=truncated,
        )

    def _record(self, **tensors: torch.Tensor) -> TensorDict:
        """The tensors with TorchRL's shapes, on the environment's device."""
        shaped = {k: v if v.ndim > 1 else v[:, None] for k, v in tensors.items()}
        return TensorDict(shaped, self.batch_size, device=self.device)
