"""A trained policy as a file: a small network with everything needed to use it rightly, and to refuse to."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, NamedTuple, Self, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic_core import from_json

from zengrid.core.observe import ObservationKind, prosumer_features
from zengrid.core.params import Homes
from zengrid.errors import PolicyError, brief
from zengrid.policy.relative import Relative, relative_features
from zengrid.policy.tensor_file import TensorFile, naming, write_tensors

Floats = NDArray[np.float64]
Role = Literal["grid", "prosumer"]
Activation = Literal["tanh", "relu"]

FORMAT = "zengrid.policy/1"
"""Kind and version of the file."""

NAME_MAX = 200
"""Longest name. [characters]"""

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
    relative:
        Whether it serves homes of any size: it is given what ``zengrid.policy.relative`` makes of an observation.

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
    relative: bool = False

    def __post_init__(self) -> None:
        for name, permitted in (("role", Role), ("observation", ObservationKind), ("activation", Activation)):
            if getattr(self, name) not in get_args(permitted):
                raise PolicyError(
                    f"{name} = {brief(repr(getattr(self, name)))}: permitted are {', '.join(get_args(permitted))}"
                )
        if not self.name.isprintable() or len(self.name) > NAME_MAX:
            raise PolicyError(f"name = {brief(repr(self.name))}: permitted are {NAME_MAX} printable characters")
        if not self.dt_h > 0.0:
            raise PolicyError(f"dt_h = {brief(repr(self.dt_h))}: permitted are lengths above 0 h")
        if self.relative and (self.role == "grid" or self.homes):
            raise PolicyError("relative = true: permitted for a prosumer's network that serves all homes")
        expected = relative_features if self.relative else prosumer_features
        if self.role == "prosumer" and self.features != expected(self.observation):
            wanted = ", ".join(expected(self.observation))
            raise PolicyError(
                f"features = {brief(', '.join(self.features))}: a prosumer's {self.observation} ones are {wanted}"
            )
        for name in ("offset", "scale"):
            self._check_numbers(name, getattr(self, name), (len(self.features),))
        self._check_numbers("levels", self.levels, (max(self.levels.size, 2),))
        if self.role == "prosumer" and np.any(np.abs(self.levels) > 1.0):
            raise PolicyError(
                f"levels = {brief(self.levels.tolist())}: battery levels are fractions of full power, -1 to 1"
            )
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

    def for_homes(self, ids: tuple[str, ...], homes: Homes, pv_kw: Floats) -> Self:
        """The same policy with a network of its own for each of some homes, to go on learning from.

        Parameters
        ----------
        ids, homes, pv_kw:
            The homes, their batteries, and their rated PV power ``(home,)`` [kW].
        """
        if self.homes:
            strangers = [home for home in ids if home not in self.homes]
            if strangers:
                raise PolicyError(f"home {strangers[0]}: the file has networks for {', '.join(self.homes)}")
            rows = [self.homes.index(home) for home in ids]
            return replace(self, homes=ids, layers=tuple(Layer(w[rows], b[rows]) for w, b in self.layers))
        each = (len(ids), 1, 1)
        layers = [Layer(np.tile(weight, each), np.tile(bias, each[:2])) for weight, bias in self.layers]
        if not self.relative:
            return replace(self, homes=ids, layers=tuple(layers))
        own = Relative.of(self.observation, homes, pv_kw)
        count = own.factor.shape[-1]
        # What scaling does for the middle home, the first layer makes up for in all others.
        factor, shift = np.median(own.factor, axis=0), np.median(own.shift, axis=0)
        offset, scale = (self.offset[:count] - shift) / factor, self.scale[:count] * factor
        first = layers[0].weight.astype(np.float64)
        weight = first[..., :count] * (own.factor / factor)[:, None]
        moved = offset * own.factor + own.shift - self.offset[:count]
        sizes = (own.sizes - self.offset[count:]) * self.scale[count:]
        constant = np.concatenate([moved * self.scale[:count], sizes], axis=-1)
        bias = layers[0].bias + np.einsum("hoi,hi->ho", first, constant)
        layers[0] = Layer(weight.astype(np.float32), bias.astype(np.float32))
        return replace(
            self, homes=ids, layers=tuple(layers), features=self.features[:count], offset=offset, scale=scale,
            relative=False,
        )  # fmt: skip

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
        write_tensors(Path(path), self._tensors(), {**self._metadata(), "format": FORMAT, "version": self.version})

    @classmethod
    def load(cls, path: Path | str) -> Self:
        """Read a file and check that everything in it fits together.

        Raises
        ------
        PolicyError
            Where it cannot be read, is no policy of this format, or contradicts itself.
        """
        path = Path(path)
        with naming("policy file", path), TensorFile(path) as file:
            texts = file.texts
            if texts.get("format") != FORMAT:
                raise PolicyError(f"format = {brief(repr(texts.get('format')))}, permitted is {FORMAT!r}")
            try:
                found = cls._of(file)
            except (KeyError, TypeError, ValueError, OverflowError) as error:
                raise PolicyError(f"lacks or misspells {brief(error)}") from None
            if texts.get("version") != found.version:
                raise PolicyError(f"was changed since it was saved as version {brief(repr(texts.get('version')))}")
        return found

    @classmethod
    def _of(cls, file: TensorFile) -> Self:
        told = {name: from_json(file.texts[name]) for name in _TEXTS}
        for name, kind in (("name", str), ("training", dict)):
            if not isinstance(told[name], kind):
                raise TypeError(f"{name} = {brief(repr(told[name]))}")
        layers = range(len(file.shapes) // 2)
        if set(file.shapes) != {f"layers.{i}.{part}" for i in layers for part in Layer._fields}:
            names = brief(", ".join(sorted(file.shapes)))
            raise PolicyError(f"tensors {names}: expected are layers.0.weight, layers.0.bias and so on")
        for name, shape in file.shapes.items():
            if shape.dtype != "float32":
                raise PolicyError(f"{name} is {shape.dtype}: permitted is float32")
        tensors = file.read()
        for name in ("offset", "scale", "levels"):
            told[name] = np.array(told[name], dtype=np.float64)
        for name in ("features", "homes"):
            told[name] = tuple(str(item) for item in told[name])
        told["relative"] = bool(from_json(file.texts.get("relative", "false")))
        return cls(
            layers=tuple(Layer(*(tensors[f"layers.{i}.{part}"] for part in Layer._fields)) for i in layers), **told
        )

    def _metadata(self) -> dict[str, str]:
        """Everything but the tensors, each as JSON."""
        told = {name: getattr(self, name) for name in _TEXTS}
        for name in ("offset", "scale", "levels"):
            told[name] = told[name].tolist()
        told["training"] = dict(self.training)
        told["hidden"] = self.hidden
        if self.relative:
            told["relative"] = True
        return {name: json.dumps(value, sort_keys=True) for name, value in told.items()}

    def _tensors(self) -> dict[str, NDArray[np.float32]]:
        return {
            f"layers.{i}.{part}": np.ascontiguousarray(getattr(layer, part), dtype=np.float32)
            for i, layer in enumerate(self.layers)
            for part in Layer._fields
        }
