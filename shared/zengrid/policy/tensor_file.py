"""Files of named arrays with texts beside them (safetensors): written whole, and read without running any of it."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from zengrid.errors import PolicyError, ZengridError, brief

Array = NDArray[Any]


class Shape(NamedTuple):
    """Type and size of an array, as the file tells them before anything is read."""

    dtype: str
    """such as ``float32``"""
    size: tuple[int, ...]

    @classmethod
    def of(cls, array: Array) -> Self:
        """Those of an array at hand."""
        return cls(array.dtype.name, array.shape)

    def __str__(self) -> str:
        return f"{self.dtype}{list(self.size)}"


_DTYPES = {
    "BOOL": "bool", "U8": "uint8", "I8": "int8", "U16": "uint16", "I16": "int16", "U32": "uint32", "I32": "int32",
    "U64": "uint64", "I64": "int64", "F16": "float16", "F32": "float32", "F64": "float64",
}  # fmt: skip
"""Types that numpy has; others are named as the file does."""


class TensorFile:
    """A file open for reading: sizes are known at once, arrays are read when they are asked for. Use it with ``with``.

    The format is a list of sizes, and the numbers one after the other: there is nothing to run or to unpack. A file
    whose sizes do not add up to its length is refused.

    Parameters
    ----------
    path:
        The file; ``naming`` adds its name to errors.

    Raises
    ------
    PolicyError
        Where it cannot be read, is no such file, or is larger than the memory of this machine.
    """

    def __init__(self, path: Path) -> None:
        from safetensors import SafetensorError, safe_open

        try:
            size = path.stat().st_size
            if not path.is_file():  # opening a pipe would wait for whoever writes to it
                raise PolicyError("cannot be read (it is not a regular file)")
            most = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
            if size > most:
                raise PolicyError(f"has {size} bytes; permitted are {most}, the memory of this machine")
            # The package's own numpy functions drop the metadata.
            self._opened = safe_open(path, framework="numpy")
        except OSError as error:
            raise PolicyError(f"cannot be read ({error.strerror or error})") from None
        except (SafetensorError, ValueError) as error:
            raise PolicyError(f"cannot be read ({error})") from None
        self.texts: dict[str, str] = self._opened.metadata() or {}
        self.shapes: dict[str, Shape] = {}
        for name in self._opened.keys():  # noqa: SIM118 - no dictionary
            part = self._opened.get_slice(name)
            dtype = str(part.get_dtype())
            self.shapes[name] = Shape(_DTYPES.get(dtype, dtype), tuple(part.get_shape()))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._opened.__exit__(kind, error, trace)

    def read(self) -> dict[str, Array]:
        """Copies of all arrays, whose types must be known to numpy."""
        return {name: self._opened.get_tensor(name) for name in self.shapes}


@contextmanager
def naming(kind: str, path: Path) -> Iterator[None]:
    """Let errors begin with the file that they are about, such as ``policy file p1.safetensors: ``."""
    try:
        yield
    except ZengridError as error:
        raise PolicyError(f"{kind} {path}: {error}") from None


def misfit(found: Mapping[str, Shape], wanted: Mapping[str, Shape]) -> str | None:
    """The first difference between the arrays that are there and those that should be, or None."""
    for name, shape in wanted.items():
        if name not in found:
            return f"{name} is missing: it must be {shape}"
        if found[name] != shape:
            return f"{name} is {found[name]}: it must be {shape}"
    extra = next((name for name in found if name not in wanted), None)
    return None if extra is None else f"{brief(extra)} is unknown: there is no such array"


def write_tensors(path: Path, arrays: Mapping[str, Array], texts: Mapping[str, str]) -> None:
    """Write a file; whoever reads at the same time finds the old one or the new one, whole."""
    from safetensors.numpy import save

    content = save({name: np.asarray(array, order="C") for name, array in arrays.items()}, dict(texts))
    part = path.with_name(f".{path.name}.{os.getpid()}")
    part.write_bytes(content)
    part.replace(path)
