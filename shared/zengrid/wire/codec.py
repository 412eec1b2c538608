"""Messages to bytes and back: JSON for everyone, safetensors columns for fleets that ask for it."""

from __future__ import annotations

from functools import cache
from typing import Any, TypeVar

import msgspec
import numpy as np
from pydantic import ValidationError
from pydantic_core import from_json, to_json

from zengrid.errors import WireError
from zengrid.validation import first_error
from zengrid.wire.base import MAX_HOMES, Message
from zengrid.wire.slot_structs import SlotStruct

JSON = "application/json"
BINARY = "application/x-safetensors"
"""Zenoh encodings. The binary one is a safetensors file: each column a float64 tensor, the rest as JSON metadata."""

M = TypeVar("M", bound=Message)
S = TypeVar("S", bound=SlotStruct)
_FLOAT = np.dtype("<f8")


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} has no place in a message")


_WRITER = msgspec.json.Encoder(enc_hook=_plain)


def encode(message: Message, encoding: str = JSON) -> bytes:
    """Bytes of a message in one of the two encodings."""
    if encoding == JSON:
        return message.__pydantic_serializer__.to_json(message)
    return encode_fields(dict(message), encoding)


def encode_fields(fields: dict[str, Any], encoding: str = JSON) -> bytes:
    """Bytes of a message that is not checked because zengrid computed it: its fields, columns as arrays or lists.

    Half the time of building the message and encoding it, which matters for what every agent is sent in every slot.
    """
    if encoding == JSON:
        return _WRITER.encode(fields)
    columns: dict[str, np.ndarray] = {}
    rest = _split(fields, "", columns)
    return _pack(columns, to_json(rest).decode())


def decode(kind: type[M], payload: bytes, encoding: str = JSON) -> M:
    """A message of the given kind.

    Raises
    ------
    WireError
        Where the bytes do not follow the schema; names the first field that is wrong.
    """
    try:
        if encoding == BINARY:
            return _decode_binary(kind, payload)
        message: M = kind.__pydantic_validator__.validate_json(payload)
        return message
    except WireError:
        raise
    except ValidationError as error:
        raise WireError(f"{kind.__name__}: {first_error(error)}") from None
    except Exception as error:  # noqa: BLE001 - a stranger chose these bytes: whatever they do to a parser is refused
        raise WireError(f"{kind.__name__}: cannot be read: {type(error).__name__}: {error}") from None


def read(kind: type[S], payload: bytes, encoding: str = JSON) -> S:
    """Decode an observation or action; in JSON check its fields and their types, but not the limits of values.

    It takes a third of the time of ``decode``, and every slot needs it. Use it where the values need no check, because
    the clock computed them or the caller compares them with what it expects.

    Raises
    ------
    WireError
        As ``decode``.
    """
    if encoding == JSON:
        try:
            struct: S = _decoder(kind).decode(payload)
            return struct
        except Exception:  # noqa: BLE001 - not only MsgspecError: the model says what is wrong
            pass
    return read_checked(kind, payload, encoding)


def read_checked(kind: type[S], payload: bytes, encoding: str = JSON) -> S:
    """Decode an observation or action like ``read``, but check everything that its model checks.

    Raises
    ------
    WireError
        As ``decode``.
    """
    return kind.of(decode(kind.model, payload, encoding))


@cache
def _decoder(kind: type[S]) -> msgspec.json.Decoder[S]:
    return msgspec.json.Decoder(kind)


def _split(fields: dict[str, Any], prefix: str, columns: dict[str, np.ndarray]) -> dict[str, Any]:
    """Move the columns of a message and its parts into ``columns``; return what is left."""
    rest: dict[str, Any] = {}
    for name, value in fields.items():
        if isinstance(value, np.ndarray):
            columns[prefix + name] = np.ascontiguousarray(value)
        elif isinstance(value, Message):
            rest[name] = _split(dict(value), f"{prefix}{name}.", columns)
        elif isinstance(value, dict):
            rest[name] = _split(value, f"{prefix}{name}.", columns)
        else:
            rest[name] = value
    return rest


def _pack(columns: dict[str, np.ndarray], message: str) -> bytes:
    """A safetensors file, written by hand: the library takes five times as long for what a slot carries."""
    header: dict[str, Any] = {"__metadata__": {"message": message}}
    end = 0
    for name, column in columns.items():
        start, end = end, end + column.size * _FLOAT.itemsize
        header[name] = {"dtype": "F64", "shape": [column.size], "data_offsets": [start, end]}
    text = to_json(header)
    text += b" " * (-len(text) % _FLOAT.itemsize)
    cells = (column.astype(_FLOAT, copy=False).data for column in columns.values())
    return b"".join([len(text).to_bytes(8, "little"), text, *cells])


def _decode_binary(kind: type[M], payload: bytes) -> M:
    start = 8 + int.from_bytes(payload[:8], "little")
    if not 8 < start <= len(payload):
        raise WireError(f"{kind.__name__}: its header ends at byte {start} of {len(payload)}")
    try:
        header = from_json(payload[8:start])
        fields = from_json(header.pop("__metadata__")["message"])
        numbers = np.frombuffer(payload, _FLOAT, offset=start)
        used = 0
        for name, tensor in header.items():
            column = _column(kind, name, tensor, numbers)
            used += column.size
            target = fields
            path, _, last = name.rpartition(".")
            for part in path.split(".") if path else ():
                target = target.get(part) if isinstance(target, dict) else None
            if not isinstance(target, dict):
                raise WireError(f"{kind.__name__}: {name}: no such column")
            target[last] = column
        if used != numbers.size:
            raise WireError(f"{kind.__name__}: {numbers.size} numbers came, the columns hold {used}")
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise WireError(f"{kind.__name__}: not a safetensors message: {error}") from None
    if not np.logical_and.reduce(np.isfinite(numbers)):
        wrong = next(name for name, it in header.items() if not np.isfinite(_column(kind, name, it, numbers)).all())
        raise WireError(f"{kind.__name__}: {wrong} holds a number that is not finite")
    message: M = kind.__pydantic_validator__.validate_python(fields)
    return message


def _column(kind: type[M], name: str, tensor: dict[str, Any], numbers: np.ndarray) -> np.ndarray:
    """The part of the numbers that a header names."""
    shape, (start, end) = tensor["shape"], tensor["data_offsets"]
    if tensor["dtype"] != "F64" or len(shape) != 1 or not 0 <= shape[0] <= MAX_HOMES:
        raise WireError(f"{kind.__name__}: {name} is {tensor['dtype']}{shape}: columns are F64[homes]")
    size = _FLOAT.itemsize
    if start % size or end - start != shape[0] * size or not 0 <= start <= end <= numbers.size * size:
        raise WireError(f"{kind.__name__}: {name} lies at bytes {start} to {end} of {numbers.size * size}")
    return numbers[start // size : end // size]
