"""Zenoh sessions with the settings of the protocol: explicit endpoints, nothing scouted, no shared memory."""

from __future__ import annotations

import ipaddress
import json
import os
from typing import Any

# Fewer hand-overs between Zenoh's own threads: 10-25 % less CPU a message. Read once, when the library starts.
os.environ.setdefault(
    "ZENOH_RUNTIME",
    "(rx: (handover: app), acc: (handover: app), tx: (handover: app), net: (handover: app), app: (worker_threads: 2))",
)

import zenoh

from zengrid.errors import BusError

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
MAX_MESSAGE_BYTES = 16 * 2**20
_LOOPBACK_NAMES = {"localhost"}


def is_loopback(endpoint: str) -> bool:
    """Whether an endpoint such as ``tcp/127.0.0.1:7447`` can only be reached from this machine."""
    protocol, _, address = endpoint.partition("/")
    if protocol == "unixsock-stream":
        return True
    host = address.rpartition(":")[0].strip("[]")
    if host in _LOOPBACK_NAMES:
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def open_clock(endpoint: str = DEFAULT_ENDPOINT, *, insecure: bool = False) -> zenoh.Session:
    """Open the hub that every agent connects to.

    Raises
    ------
    BusError
        Where the endpoint is not on loopback and ``insecure`` is not set, or cannot be listened on.
    """
    if not insecure and not is_loopback(endpoint):
        raise BusError(
            f"endpoint = {endpoint}: only loopback is allowed without authentication, such as {DEFAULT_ENDPOINT}; "
            "pass --insecure to let anyone who reaches this address take part"
        )
    return _open(
        {
            "mode": "peer",
            "listen/endpoints": [endpoint],
            "listen/exit_on_failure": True,
            "connect/endpoints": [],
            "transport/link/rx/max_message_size": MAX_MESSAGE_BYTES,
            # A reader that does not keep up loses public slots at once instead of holding up the market.
            "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 0,
            # A stuck agent that is still waited for must not hold up the others for longer than this [us].
            "transport/link/tx/queue/congestion_control/block/wait_before_close": 500_000,
        },
        endpoint,
    )


def open_client(endpoint: str = DEFAULT_ENDPOINT, *, timeout_s: float = 30.0) -> zenoh.Session:
    """Open an agent's or operator's session; waits until the clock (or a router) can be reached.

    Raises
    ------
    BusError
        Where nobody listens on the endpoint within the time.
    """
    return _open(
        {
            "mode": "client",
            "listen/endpoints": [],
            "connect/endpoints": [endpoint],
            "connect/timeout_ms": int(timeout_s * 1000),
            "connect/exit_on_failure": True,
            "connect/retry": {"period_init_ms": 20, "period_max_ms": 500, "period_increase_factor": 1.5},
            # An answer must not wait for long on a link that died meanwhile: a new one is made at once [us].
            "transport/link/tx/queue/congestion_control/block/wait_before_close": 100_000,
            # What this node announces about itself: a stopped process is given up after this time [ms].
            "transport/link/tx/lease": 3000,
        },
        endpoint,
        hint=f": nobody listens there after {timeout_s:g} s; is the market running (zengrid up)?",
    )


def _open(settings: dict[str, Any], endpoint: str, hint: str = "") -> zenoh.Session:
    config = zenoh.Config()
    common = {
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/shared_memory/enabled": False,
    }
    for key, value in {**common, **settings}.items():
        config.insert_json5(key, json.dumps(value))
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise BusError(f"endpoint = {endpoint}{hint or f': {error}'.splitlines()[0].split(' at ')[0]}") from None
