"""Where a market listens: free places are found, taken ones are named."""

from __future__ import annotations

import socket

import pytest

from zengrid.errors import BusError
from zengrid_cli.local_market.free_endpoints import choose_endpoint, choose_http_port, free_port, is_free


@pytest.fixture
def taken() -> object:
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server.getsockname()[1]


def test_a_free_endpoint_is_taken_as_it_is() -> None:
    wanted = f"tcp/127.0.0.1:{free_port()}"
    assert choose_endpoint(wanted) == wanted


def test_a_taken_one_is_named(taken: int) -> None:
    with pytest.raises(BusError, match=rf"--listen tcp/127.0.0.1:{taken}: another process .* --listen auto"):
        choose_endpoint(f"tcp/127.0.0.1:{taken}")
    assert not is_free("localhost", taken)


def test_auto_finds_a_free_endpoint() -> None:
    found = choose_endpoint("auto")
    assert found.startswith("tcp/127.0.0.1:")
    assert choose_endpoint(found) == found


@pytest.mark.parametrize("wanted", ["unixsock-stream//tmp/zengrid.sock", "tcp/no.such.host.invalid:7447", "nonsense"])
def test_what_cannot_be_checked_is_left_to_zenoh(wanted: str) -> None:
    assert choose_endpoint(wanted) == wanted


def test_the_page_moves_where_its_usual_port_is_taken(taken: int) -> None:
    usual = free_port()
    assert choose_http_port(None, usual) == usual
    assert choose_http_port(None, taken) != taken
    assert choose_http_port(usual, taken) == usual
    with pytest.raises(BusError, match=f"--http {taken}: another process listens there"):
        choose_http_port(taken, usual)
