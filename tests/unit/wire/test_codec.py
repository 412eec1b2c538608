"""Messages survive both encodings to the last bit; what does not follow the schema is refused in one clear line."""

from __future__ import annotations

import json
from contextlib import suppress
from typing import Any

import numpy as np
import pytest
import safetensors.numpy
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from zengrid.errors import WireError
from zengrid.wire.codec import BINARY, JSON, decode, encode, encode_fields, read, read_checked
from zengrid.wire.queries import JoinRequest
from zengrid.wire.slot_structs import FleetActionStruct, FleetObservationStruct, FleetSettledStruct
from zengrid.wire.slots import FleetAction, FleetObservation, FleetSettled, GridAction

numbers = st.floats(allow_nan=False, allow_infinity=False)


def columns(homes: int) -> st.SearchStrategy[np.ndarray]:
    return hnp.arrays(np.float64, homes, elements=numbers)


@st.composite
def observations(draw: st.DrawFn) -> FleetObservation:
    homes = draw(st.integers(0, 20))
    settled = FleetSettled(
        day=1, slot=2, buy_price=0.05, fallback=draw(st.booleans()), reward=draw(columns(homes)),
        battery_kw=draw(columns(homes)), injection_kw=draw(columns(homes)),
    )  # fmt: skip
    return FleetObservation(
        run="main", day=draw(st.integers(0, 10**9)), slot=3, hour=draw(st.floats(0, 23.99)), deadline_s=2.0,
        buy_price=0.05, sell_price=0.095, soc=draw(columns(homes)), pv_kw=draw(columns(homes)),
        load_kw=draw(columns(homes)), settled=draw(st.sampled_from([None, settled])),
    )  # fmt: skip


@given(observations(), st.sampled_from([JSON, BINARY]))
def test_every_bit_survives(message: FleetObservation, encoding: str) -> None:
    back = decode(FleetObservation, encode(message, encoding), encoding)
    for name in ("soc", "pv_kw", "load_kw"):
        assert np.asarray(getattr(back, name)).tobytes() == np.asarray(getattr(message, name)).tobytes()
    assert encode(back) == encode(message)


@given(observations(), st.sampled_from([JSON, BINARY]), st.sampled_from([read, read_checked]))
def test_reading_gives_what_decoding_gives(message: FleetObservation, encoding: str, reader: Any) -> None:
    payload = encode(message, encoding)
    struct, checked = reader(FleetObservationStruct, payload, encoding), decode(FleetObservation, payload, encoding)
    assert isinstance(struct, FleetObservationStruct)
    for name in set(FleetObservation.model_fields) - {"settled"}:
        assert encode_fields({name: getattr(struct, name)}) == encode_fields({name: getattr(checked, name)})
    assert (struct.settled is None) == (checked.settled is None)
    if struct.settled is not None and checked.settled is not None:
        assert isinstance(struct.settled, FleetSettledStruct)
        for name in FleetSettled.model_fields:
            assert np.array_equal(getattr(struct.settled, name), getattr(checked.settled, name))


ACTION = '{"v":1,"run":"main","day":0,"slot":3,"phase":"battery","instance":"0123456789","battery_kw":[%s]}'


@pytest.mark.parametrize(
    ("payload", "says"),
    [
        (b"", "FleetAction: message"),
        (b"\xff\xfe", "Invalid JSON"),
        (b"[]", "FleetAction: message"),
        (b"{}", "run = {}: Field required"),
        (b'{"\xff":0}', "invalid unicode code point"),
        (b"[" * 100_000, "recursion limit exceeded"),
        ((ACTION % "NaN").encode(), "battery_kw.0 = nan: Input should be a finite number"),
        ((ACTION % "1e999").encode(), "battery_kw.0 = inf"),
        ((ACTION % '"1"').encode(), "battery_kw.0 = '1'"),
        ((ACTION % "1").replace('"v":1', '"v":2').encode(), "v = 2: Input should be 1"),
        ((ACTION % "1").replace("}", ',"extra":1}').encode(), "extra = 1: Extra inputs are not permitted"),
        ((ACTION % "1").replace("main", "../x").encode(), "run = '../x'"),
        ((ACTION % "1").replace("0123456789", "x").encode(), "instance = 'x'"),
    ],
)
def test_bad_json_is_refused_in_one_line(payload: bytes, says: str) -> None:
    with pytest.raises(WireError, match="FleetAction") as caught:
        decode(FleetAction, payload)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("payload", "says"),
    [
        ((ACTION % "NaN").encode(), "battery_kw.0 = nan: Input should be a finite number"),
        ((ACTION % '"1"').encode(), "battery_kw.0 = '1'"),
        ((ACTION % "true").encode(), "battery_kw.0 = True"),
        ((ACTION % "1").replace('"v":1', '"v":2').encode(), "v = 2: Input should be 1"),
        ((ACTION % "1").replace('"day":0', '"day":0.0').encode(), "day = 0.0"),
        ((ACTION % "1").replace("}", ',"extra":1}').encode(), "extra = 1: Extra inputs are not permitted"),
    ],
)
def test_read_refuses_other_fields_and_types(payload: bytes, says: str) -> None:
    with pytest.raises(WireError) as caught:
        read(FleetActionStruct, payload)
    assert says in str(caught.value)


@given(st.binary(max_size=200))
def test_random_bytes_are_refused(payload: bytes) -> None:
    for encoding in (JSON, BINARY):
        with pytest.raises(WireError):
            decode(FleetAction, payload, encoding)
        with pytest.raises(WireError):
            read(FleetActionStruct, payload, encoding)


@given(st.sampled_from([JSON, BINARY]), st.data())
def test_changed_bytes_give_a_message_or_a_wire_error(encoding: str, data: st.DataObject) -> None:
    action = FleetAction(run="main", day=0, slot=0, instance="01234567", battery_kw=np.ones(3))
    payload = bytearray(encode(action, encoding))
    places = data.draw(st.lists(st.integers(0, len(payload) - 1), min_size=1, max_size=12))
    for place, byte in zip(places, data.draw(st.binary(min_size=len(places), max_size=len(places))), strict=True):
        payload[place] = byte
    with suppress(WireError):
        assert decode(FleetAction, bytes(payload), encoding).v == 1
    with suppress(WireError):
        assert read(FleetActionStruct, bytes(payload), encoding).v == 1


@given(st.data())
def test_truncated_binary_is_refused(data: st.DataObject) -> None:
    whole = encode(FleetAction(run="main", day=0, slot=0, instance="01234567", battery_kw=np.ones(5)), BINARY)
    cut = data.draw(st.integers(0, len(whole) - 1))
    with pytest.raises(WireError):
        decode(FleetAction, whole[:cut], BINARY)


def test_binary_is_what_the_safetensors_library_reads_and_writes() -> None:
    action = FleetAction(run="main", day=0, slot=3, instance="01234567", battery_kw=np.array([1.5, -2.0, 0.1]))
    whole = encode(action, BINARY)
    assert safetensors.numpy.load(whole)["battery_kw"].tolist() == [1.5, -2.0, 0.1]
    rest = json.dumps({"run": "main", "day": 0, "slot": 3, "phase": "battery", "instance": "01234567"})
    theirs = safetensors.numpy.save({"battery_kw": np.asarray(action.battery_kw)}, {"message": rest})
    assert encode(decode(FleetAction, theirs, BINARY), BINARY) == whole


@pytest.mark.parametrize(
    ("tensor", "says"),
    [
        ({"dtype": "F64", "shape": [2], "data_offsets": [0, 24]}, "battery_kw lies at bytes 0 to 24 of 24"),
        ({"dtype": "F64", "shape": [4], "data_offsets": [0, 32]}, "battery_kw lies at bytes 0 to 32 of 24"),
        ({"dtype": "F64", "shape": [3], "data_offsets": [-8, 16]}, "battery_kw lies at bytes -8 to 16 of 24"),
        ({"dtype": "F64", "shape": [-1], "data_offsets": [8, 0]}, "columns are F64[homes]"),
        ({"dtype": "F64", "shape": [2], "data_offsets": [0, 16]}, "3 numbers came, the columns hold 2"),
        ({"dtype": "F32", "shape": [6], "data_offsets": [0, 24]}, "battery_kw is F32[6]: columns are F64[homes]"),
        ({"dtype": "F64", "shape": [3.5], "data_offsets": [0, 28]}, "battery_kw lies"),
        ({"dtype": "F64", "shape": "x", "data_offsets": [0, 8]}, "not a safetensors message"),
        ({"dtype": "F64", "shape": [3]}, "not a safetensors message"),
        (7, "not a safetensors message"),
    ],
)
def test_a_binary_header_must_describe_its_numbers(tensor: object, says: str) -> None:
    head = json.dumps({"__metadata__": {"message": "{}"}, "battery_kw": tensor}).encode()
    payload = len(head).to_bytes(8, "little") + head + np.ones(3).tobytes()
    with pytest.raises(WireError) as caught:
        decode(FleetAction, payload, BINARY)
    assert says in str(caught.value)


@pytest.mark.parametrize("length", [2**64 - 1, 2**63, 2**40, 34, 0])
def test_a_binary_header_must_lie_within_its_message(length: int) -> None:
    with pytest.raises(WireError, match="its header ends at byte"):
        decode(FleetAction, length.to_bytes(8, "little") + b'{"__metadata__":{"message":"{}"}}', BINARY)


def test_binary_columns_must_be_finite() -> None:
    bad = FleetAction.model_construct(
        v=1, run="main", day=0, slot=0, phase="battery", instance="01234567", battery_kw=np.array([np.nan])
    )
    with pytest.raises(WireError, match="battery_kw holds a number that is not finite"):
        decode(FleetAction, encode(bad, BINARY), BINARY)


def test_a_price_must_be_a_price() -> None:
    with pytest.raises(WireError, match="buy_price = -1"):
        decode(GridAction, b'{"run":"main","day":0,"slot":3,"instance":"0123456789","buy_price":-1}')


def test_a_joining_home_is_checked_by_the_scenarios_own_rules() -> None:
    request = b'{"agent":"p4","role":"prosumer","instance":"0123456789","homes":[{"id":"p4","pv_kw":-5}]}'
    with pytest.raises(WireError, match=r"homes.0.pv_kw = -5: Input should be greater than or equal to 0"):
        decode(JoinRequest, request)
