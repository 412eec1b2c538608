"""Messages to bytes and back: JSON for everyone, safetensors columns for fleets that ask for it."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from pydantic import ValidationError
from pydantic_core import from_json, to_json

from zengrid.errors import WireError
from zengrid.wire.base import MAX_HOMES, Message

JSON = "application/json"
BINARY = "application/x-safetensors"
"""Zenoh encodings. The binary one is a safetensors file: each column a float64 tensor, the rest as JSON metadata."""

M = TypeVar("M", bound=Message)


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
        return to_json(fields, fallback=_plain)
    from safetensors.numpy import save

    columns: dict[str, np.ndarray] = {}
    rest = _split(fields, "", columns)
    return save(columns, metadata={"message": to_json(rest).decode()})


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
    except ValidationError as error:
        raise WireError(f"{kind.__name__}: {explain(error)}") from None


def explain(error: ValidationError) -> str:
    """The first thing pydantic found wrong, as one line."""
    first = error.errors(include_url=False, include_context=False)[0]
    field = ".".join(str(part) for part in first["loc"]) or "message"
    value = repr(first["input"])
    shown = value if len(value) <= 60 else value[:57] + "..."
    return f"{field} = {shown}: {first['msg']}"


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} has no place in a message")


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


def _decode_binary(kind: type[M], payload: bytes) -> M:
    from safetensors import SafetensorError, deserialize

    # The header must be read by hand for its metadata: the library's numpy front end drops it.
    try:
        length = int.from_bytes(payload[:8], "little")
        header = from_json(payload[8 : 8 + length])
        fields = from_json(header["__metadata__"]["message"])
        tensors = deserialize(payload)
    except (ValueError, KeyError, TypeError, SafetensorError) as error:
        raise WireError(f"{kind.__name__}: not a safetensors message: {error}") from None
    for name, tensor in tensors:
        if tensor["dtype"] != "F64" or len(tensor["shape"]) != 1 or tensor["shape"][0] > MAX_HOMES:
            raise WireError(f"{kind.__name__}: {name} is {tensor['dtype']}{tensor['shape']}: columns are F64[homes]")
        column = np.frombuffer(tensor["data"], dtype="<f8")
        if not np.isfinite(column).all():
            raise WireError(f"{kind.__name__}: {name} holds a number that is not finite")
        target = fields
        *path, last = name.split(".")
        for part in path:
            target = target.get(part) if isinstance(target, dict) else None
        if not isinstance(target, dict):
            raise WireError(f"{kind.__name__}: {name}: no such column")
        target[last] = column
    message: M = kind.__pydantic_validator__.validate_python(fields)
    return message
