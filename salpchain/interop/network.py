"""A policy as a plain PyTorch module, which needs no JAX to run.

Meaning and names of the layers are those of `networks/layers.py`. Files are safetensors: data only.
"""

import json
from typing import Any

import numpy as np

from salpchain.errors import InputError
from salpchain.files import StrPath, read_arrays, write_arrays
from salpchain.given import path as checked_path
from salpchain.interop.extras import need
from salpchain.networks.config import PAPER_DEPTH, REACH
from salpchain.tasks.features import observation_size

need("torch", "torch")

import torch
from torch import Tensor, nn
from torch.nn import functional

KIND, VERSION = "torch policy", 1
MASKED = -torch.inf
NEEDED = {"model", "graph", "action", "observation", "serves_units"}  # of `about`

Weights = dict[str, Tensor]


class TorchPolicy(nn.Module):
    """Actions (..., unit, act) in [-1, 1] of observations (..., unit, feature), any length.

    `about` says what the numbers are, as the metadata of an ONNX file does.
    """

    def __init__(self, weights: Weights, about: dict[str, str]) -> None:
        """The module with these weights, of the names that `save_torch` gives."""
        super().__init__()
        self.about = about
        for name, value in weights.items():
            self.register_parameter(name.replace(".", "_"), nn.Parameter(value))

    def forward(self, obs: Tensor) -> Tensor:
        """The mean actions, clipped.

        Raises:
            InputError: observations of another shape.
        """
        self._check_shape(obs)
        model = self.about["model"]
        depth = int(self.about.get("depth", PAPER_DEPTH))  # files of older versions do not say
        if model == "mlp":
            row = self._head(obs.flatten(-2))
            return row.unflatten(-1, (obs.shape[-2], -1)).clamp(-1, 1)
        x, sees = self._nodes(obs)
        if model == "gt":
            x = self._linear("trunk_entry", x)
            for layer in (f"trunk_blocks_{number}" for number in range(depth)):
                x = x + functional.gelu(self._transformer(f"{layer}_layer", x, sees))
                norm = self._get(f"{layer}_norm_scale"), self._get(f"{layer}_norm_shift")
                x = functional.layer_norm(x, x.shape[-1:], *norm)
        else:
            conv = self._gcn if model == "gcn" else self._gatv2
            x = functional.gelu(conv("trunk_first", x, sees))
            deeper = [f"trunk_more_{number}" for number in range(depth - 2)]
            for layer in ("trunk_second", *deeper):
                x = functional.gelu(conv(layer, functional.layer_norm(x, x.shape[-1:]), sees))
        return self._head(x[..., : obs.shape[-2], :]).clamp(-1, 1)

    def _check_shape(self, obs: Tensor) -> None:
        units = self.about["serves_units"]
        features = observation_size(self.about["observation"])
        fits = obs.ndim >= 2 and obs.shape[-1] == features
        if not fits or units not in ("any", str(obs.shape[-2])):
            raise InputError(
                f"observations must have shape (..., {units}, {features}), got {tuple(obs.shape)}"
            )

    def thrust(self, obs: Tensor) -> Tensor:
        """Thrusts (..., unit) in newton along each unit's heading."""
        action = self(obs)
        one = self.about["action"] == "thrust"
        return action[..., 0] if one else (action[..., 0] - action[..., 1]) / 2

    def _get(self, name: str) -> Tensor:
        return self.get_parameter(name)

    def _linear(self, name: str, x: Tensor) -> Tensor:
        return x @ self._get(f"{name}_weight") + self._get(f"{name}_bias")

    def _head(self, x: Tensor) -> Tensor:
        for layer in (0, 1):
            x = functional.gelu(self._linear(f"actor_layers_{layer}", x))
        return self._linear("actor_layers_2", x)

    def _nodes(self, obs: Tensor) -> tuple[Tensor, Tensor]:
        """What each node of the graph observes, and whether node i sees node j, (node, node)."""
        units, graph = obs.shape[-2], self.about["graph"]
        others = 1 if graph == "hub" else 0
        place = torch.arange(units + others, device=obs.device)
        reach = {"mixed": 1, "hub": 1, "near": REACH, "full": units}[graph]
        near = (place[:, None] - place).abs() <= reach
        is_hub = place >= units
        return functional.pad(obs, (0, 0, 0, others)), near | is_hub | is_hub[:, None]

    def _gcn(self, name: str, x: Tensor, sees: Tensor) -> Tensor:
        weights = sees.to(x.dtype)
        if self.about["graph"] == "hub":  # which hears the mean of the units
            weights[-1, :-1] /= len(sees) - 1
        if self.about.get("improved") == "true":  # files of older versions do not say
            weights = weights + torch.eye(len(sees), dtype=x.dtype, device=x.device)
        scale = weights.sum(1).rsqrt()
        passed = scale[:, None] * weights * scale
        return self._linear(f"{name}_linear", passed @ x)

    def _gatv2(self, name: str, x: Tensor, sees: Tensor) -> Tensor:
        attention = self._get(f"{name}_attention")
        heads = attention.shape[0]
        source, target = (
            self._linear(f"{name}_{side}", x).unflatten(-1, (heads, -1))
            for side in ("source", "target")
        )
        both = functional.leaky_relu(target[..., :, None, :, :] + source[..., None, :, :, :], 0.2)
        heard = _attend((both * attention).sum(-1), source, sees)
        return heard.flatten(-2) + self._get(f"{name}_bias")

    def _transformer(self, name: str, x: Tensor, sees: Tensor) -> Tensor:
        query, key, value = (
            self._linear(f"{name}_{part}", x).unflatten(-1, (2, -1))
            for part in ("query", "key", "value")
        )
        scores = torch.einsum("...ihf,...jhf->...ijh", query, key) / query.shape[-1] ** 0.5
        heard, own = _attend(scores, value, sees).mean(-2), self._linear(f"{name}_skip", x)
        parts = torch.cat([heard, own, heard - own], -1)
        gate = torch.sigmoid(parts @ self._get(f"{name}_gate"))[..., None]
        return gate * own + (1 - gate) * heard


def _attend(scores: Tensor, values: Tensor, sees: Tensor) -> Tensor:
    """Values of the units seen, weighted by the softmax of the scores (..., unit, seen, head)."""
    weights = scores.masked_fill(~sees[..., None], MASKED).softmax(-2)
    return torch.einsum("...ijh,...jhf->...ihf", weights, values)


def save_torch(arrays: dict[str, Any], about: dict[str, str], path: StrPath) -> None:
    """The weights of trunk and actor, as `salpchain.trees.to_arrays` names them, as one file.

    Raises:
        OSError: the folder is missing or not writable, or the disk is full.
    """
    used = {
        name.replace("[", ".").replace("]", ""): np.asarray(array)
        for name, array in arrays.items()
        if name.startswith(("trunk", "actor"))
    }
    write_arrays(path, KIND, VERSION, about, used)


def load_torch(path: StrPath) -> TorchPolicy:
    """The module in a file of `salpchain export --format torch`, ready to act.

    Raises:
        InputError: no such file; damaged, altered or from a newer version.
    """
    about, arrays = read_arrays(checked_path("path", path), KIND, VERSION)
    if not about.keys() >= NEEDED:
        raise InputError(f"{path} does not say which network it holds: {json.dumps(about)[:60]}")
    weights = {name: torch.from_numpy(array.copy()) for name, array in arrays.items()}
    return TorchPolicy(weights, about).eval().requires_grad_(False)
