"""A trained policy as a file: a small network with everything needed to use it rightly, and to refuse to."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, NamedTuple, Self, get_args

import numpy as np
from numpy.typing import NDArray

from zengrid.core.observe import ObservationKind, prosumer_features
from zengrid.errors import PolicyError

Floats = NDArray[np.float64]
Role = Literal["grid", "prosumer"]
Activation = Literal["tanh", "relu"]

FORMAT = "zengrid.policy/1"
"""Kind and version of the file."""

_TEXTS = (
    "role",
    "observation",
    "features",
    "offset",
    "scale",
    "levels",
    "activation",
    "dt_h",
    "name",
    "homes",
    "training",
)


class Layer(NamedTuple):
    """One layer of the network, as torch's ``Linear`` keeps it.

    weight: ``(output, input)``, or ``(home, output, input)`` where each home has a network of its own.
    bias: ``(output,)`` or ``(home, output)``.
    """

    weight: NDArray[np.float32]
    bias: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class PolicyFile:
    """A network that maps an observation to one Q-value for each level; the policy takes the level of the largest.

    Parameters
    ----------
    role:
        Who it decides for.
    observation, features:
        What it sees: the kind, and the name of each number in order (``zengrid.core.observe``).
    offset, scale:
        The network is given ``(observation - offset) * scale``, ``(feature,)`` each.
    levels:
        Its actions: buy prices [$/kWh], or for batteries fractions from -1 to 1 of full power [-].
    activation:
        Between the layers; the last one is linear.
    layers:
        From input to output.
    dt_h:
        Length of the slots it was trained on. [h]
    name:
        For display.
    homes:
        Whose networks these are, where each home has its own; empty where one serves all.
    training:
        How it was made: scenario, seed, command and the like.

    Raises
    ------
    PolicyError
        Where these do not fit together.
    """

    role: Role
    observation: ObservationKind
    features: tuple[str, ...]
    offset: Floats
    scale: Floats
    levels: Floats
    activation: Activation
    layers: tuple[Layer, ...]
    dt_h: float
    name: str
    homes: tuple[str, ...] = ()
    training: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, permitted in (("role", Role), ("observation", ObservationKind), ("activation", Activation)):
            if getattr(self, name) not in get_args(permitted):
                raise PolicyError(f"{name} = {getattr(self, name)!r}: permitted are {', '.join(get_args(permitted))}")
        if not self.dt_h > 0.0:
            raise PolicyError(f"dt_h = {self.dt_h!r}: permitted are lengths above 0 h")
        if self.role == "prosumer" and self.features != prosumer_features(self.observation):
            wanted = ", ".join(prosumer_features(self.observation))
            raise PolicyError(
                f"features = {', '.join(self.features)}: a prosumer's {self.observation} ones are {wanted}"
            )
        for name in ("offset", "scale"):
            self._check_numbers(name, getattr(self, name), (len(self.features),))
        self._check_numbers("levels", self.levels, (max(self.levels.size, 2),))
        if self.role == "prosumer" and np.any(np.abs(self.levels) > 1.0):
            raise PolicyError(f"levels = {self.levels.tolist()}: battery levels are fractions of full power, -1 to 1")
        if not self.layers:
            raise PolicyError("layers: there is none")
        own = (len(self.homes),) if self.homes else ()
        inputs = len(self.features)
        for i, (weight, bias) in enumerate(self.layers):
            last = i == len(self.layers) - 1
            outputs = self.levels.size if last else weight.shape[-2] if weight.ndim > 1 else 0
            self._check_numbers(f"layers.{i}.weight", weight, (*own, outputs, inputs))
            self._check_numbers(f"layers.{i}.bias", bias, (*own, outputs))
            inputs = outputs

    @staticmethod
    def _check_numbers(name: str, values: NDArray[Any], shape: tuple[int, ...]) -> None:
        if values.shape != shape:
            raise PolicyError(f"{name} has shape {values.shape}: it must be {shape}")
        if not np.isfinite(values).all():
            raise PolicyError(f"{name} has numbers that are not finite")

    @property
    def hidden(self) -> tuple[int, ...]:
        """Sizes of the layers between input and output."""
        return tuple(layer.bias.shape[-1] for layer in self.layers[:-1])

    @cached_property
    def version(self) -> str:
        """Twelve digits of a hash of everything that decides; training notes and name are not part of it."""
        told = {name: text for name, text in self._metadata().items() if name not in ("name", "training")}
        digest = hashlib.sha256(json.dumps(told, sort_keys=True).encode())
        for name, tensor in sorted(self._tensors().items()):
            digest.update(f"{name} {tensor.shape}".encode())
            digest.update(tensor.tobytes())
        return digest.hexdigest()[:12]

    def save(self, path: Path | str) -> None:
        """Write the file; whoever reads at the same time finds the old one or the new one, whole."""
        from safetensors.numpy import save

        path = Path(path)
        content = save(self._tensors(), {**self._metadata(), "format": FORMAT, "version": self.version})
        part = path.with_name(f".{path.name}.{os.getpid()}")
        part.write_bytes(content)
        part.replace(path)

    @classmethod
    def load(cls, path: Path | str) -> Self:
        """Read a file and check that everything in it fits together.

        Raises
        ------
        PolicyError
            Where it cannot be read, is no policy of this format, or contradicts itself.
        """
        # The package's own numpy functions drop the metadata.
        from safetensors import SafetensorError, safe_open

        try:
            with safe_open(path, framework="numpy") as opened:
                metadata = opened.metadata() or {}
                tensors = {name: opened.get_tensor(name) for name in opened.keys()}  # noqa: SIM118 - no dictionary
        except (OSError, SafetensorError) as error:
            raise PolicyError(f"policy file {path}: cannot be read ({error})") from None
        if metadata.get("format") != FORMAT:
            raise PolicyError(f"policy file {path}: format = {metadata.get('format')!r}, permitted is {FORMAT!r}")
        try:
            found = cls._of(metadata, tensors)
        except PolicyError as error:
            raise PolicyError(f"policy file {path}: {error}") from None
        except (KeyError, TypeError, ValueError) as error:
            raise PolicyError(f"policy file {path}: lacks or misspells {error}") from None
        if metadata.get("version") != found.version:
            raise PolicyError(
                f"policy file {path}: was changed since it was saved as version {metadata.get('version')}"
            )
        return found

    @classmethod
    def _of(cls, metadata: Mapping[str, str], tensors: Mapping[str, NDArray[Any]]) -> Self:
        told = {name: json.loads(metadata[name]) for name in _TEXTS}
        names = {f"layers.{i}.{part}" for i in range(len(tensors) // 2) for part in Layer._fields}
        if set(tensors) != names:
            raise PolicyError(
                f"tensors {', '.join(sorted(tensors))}: expected are layers.0.weight, layers.0.bias and so on"
            )
        wrong = [name for name, tensor in tensors.items() if tensor.dtype != np.float32]
        if wrong:
            raise PolicyError(f"{wrong[0]} is {tensors[wrong[0]].dtype}: permitted is float32")
        layers = (Layer(tensors[f"layers.{i}.weight"], tensors[f"layers.{i}.bias"]) for i in range(len(tensors) // 2))
        for name in ("offset", "scale", "levels"):
            told[name] = np.array(told[name], dtype=np.float64)
        for name in ("features", "homes"):
            told[name] = tuple(str(item) for item in told[name])
        return cls(layers=tuple(layers), **told)

    def _metadata(self) -> dict[str, str]:
        """Everything but the tensors, each as JSON."""
        told = {name: getattr(self, name) for name in _TEXTS}
        for name in ("offset", "scale", "levels"):
            told[name] = told[name].tolist()
        told["training"] = dict(self.training)
        told["hidden"] = self.hidden
        return {name: json.dumps(value, sort_keys=True) for name, value in told.items()}

    def _tensors(self) -> dict[str, NDArray[np.float32]]:
        return {
            f"layers.{i}.{part}": np.ascontiguousarray(getattr(layer, part), dtype=np.float32)
            for i, layer in enumerate(self.layers)
            for part in Layer._fields
        }
