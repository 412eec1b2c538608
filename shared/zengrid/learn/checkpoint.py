"""Checkpoints: what learning goes on from, as arrays and plain values in a file that holds nothing to run."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Generic, NamedTuple, Self, TypeVar

import numpy as np
import torch
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from torch import Tensor

from zengrid.errors import PolicyError, brief
from zengrid.policy.tensor_file import Shape, TensorFile, misfit, write_tensors
from zengrid.validation import first_error

Count = Annotated[int, Field(ge=0, lt=2**63)]
Finite = Annotated[float, Field(allow_inf_nan=False)]


class Values(BaseModel):
    """What is no array: frozen, unknown fields refused, nothing converted."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, ser_json_inf_nan="constants")


V = TypeVar("V", bound=Values)
A = TypeVar("A")


class State(NamedTuple, Generic[V]):
    """The values and arrays of a learner, or of a part of one."""

    values: V
    tensors: dict[str, Tensor]


def under(name: str, arrays: Mapping[str, A]) -> dict[str, A]:
    """The arrays of a part, or their sizes, as the whole calls them."""
    return {f"{name}.{each}": array for each, array in arrays.items()}


def part(name: str, tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """The inverse of ``under``."""
    return {each.removeprefix(f"{name}."): tensor for each, tensor in tensors.items() if each.startswith(f"{name}.")}


def shapes(tensors: Mapping[str, Tensor]) -> dict[str, Shape]:
    """Type and size of each array."""
    return {name: Shape(str(it.dtype).removeprefix("torch."), tuple(it.shape)) for name, it in tensors.items()}


def put(tensors: Mapping[str, Tensor], into: Mapping[str, Tensor]) -> None:
    """Copy all arrays into those of the same names."""
    with torch.no_grad():
        for name, target in into.items():
            target.copy_(tensors[name])


def check(tensors: Mapping[str, Tensor], wanted: Mapping[str, Shape]) -> None:
    """Refuse arrays that are not as wanted, or hold what is not a finite number."""
    wrong = misfit(shapes(tensors), wanted)
    if wrong is not None:
        raise PolicyError(wrong)
    for name, tensor in tensors.items():
        if tensor.dtype == torch.bool and tensor.numel() and int(tensor.view(torch.uint8).max()) > 1:
            raise PolicyError(f"{name} has truth values that are neither true nor false")
        if tensor.is_floating_point() and not bool(tensor.isfinite().all()):
            raise PolicyError(f"{name} has numbers that are not finite")


def within(name: str, tensors: Mapping[str, Tensor], low: float, high: float) -> None:
    """Refuse an array with numbers beyond these limits."""
    tensor = tensors[name]
    if tensor.numel():
        least, most = float(tensor.min()), float(tensor.max())
        if least < low or most > high:
            raise PolicyError(f"{name} has numbers from {least:g} to {most:g}: permitted are {low:g} to {high:g}")


# ---------------------------------------------------------------- random generators


class NumpyGenerator(Values):
    """The state of numpy's generator."""

    state: Annotated[int, Field(ge=0, lt=2**128)]
    inc: Annotated[int, Field(ge=0, lt=2**128)]
    has_uint32: Annotated[int, Field(ge=0, le=1)]
    uinteger: Annotated[int, Field(ge=0, lt=2**32)]

    @classmethod
    def of(cls, generator: np.random.Generator) -> Self:
        """As it is now."""
        state: Any = generator.bit_generator.state
        return cls(**state["state"], has_uint32=state["has_uint32"], uinteger=state["uinteger"])

    def made(self) -> np.random.Generator:
        """A generator that goes on from here."""
        bits = np.random.PCG64()
        bits.state = {
            "bit_generator": "PCG64", "state": {"state": self.state, "inc": self.inc}, "has_uint32": self.has_uint32,
            "uinteger": self.uinteger,
        }  # fmt: skip
        return np.random.Generator(bits)


def check_generator(state: Tensor, generator: torch.Generator) -> None:
    """Refuse what torch cannot go on from; the generator itself stays as it is."""
    try:
        torch.Generator(generator.device).set_state(state)
    except RuntimeError as error:
        raise PolicyError(f"generator is no state of torch's random numbers ({error})") from None


# ---------------------------------------------------------------- files


def save(path: Path, format: str, state: State[Any]) -> None:
    """Write a checkpoint; an interruption leaves the one before."""
    arrays = {name: tensor.detach().cpu().numpy() for name, tensor in state.tensors.items()}
    write_tensors(path, arrays, {"format": format, "values": state.values.model_dump_json()})


def read_values(file: TensorFile, format: str, model: type[V]) -> V:
    """The values of a checkpoint of this kind and version; its arrays are not read yet."""
    if file.texts.get("format") != format:
        raise PolicyError(f"format = {brief(repr(file.texts.get('format')))}, permitted is {format!r}")
    try:
        return model.model_validate_json(file.texts.get("values", ""))
    except ValidationError as error:
        raise PolicyError(first_error(error)) from None


def read_tensors(file: TensorFile, wanted: Mapping[str, Shape]) -> dict[str, Tensor]:
    """The arrays of a checkpoint, which must have these types and sizes."""
    wrong = misfit(file.shapes, wanted)
    if wrong is not None:
        raise PolicyError(wrong)
    return {name: torch.from_numpy(array) for name, array in file.read().items()}
