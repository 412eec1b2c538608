"""Zenoh sessions with the settings of the protocol: explicit endpoints, nothing scouted, no shared memory."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path
from typing import Any

import zenoh

from zengrid.bus.addresses import DEFAULT_ENDPOINT, is_loopback_endpoint
from zengrid.bus.credentials import CLOCK, Credentials, secured
from zengrid.errors import BusError, SecurityError

RUNTIME = "ZENOH_RUNTIME"
HANDOVER = (
    "(rx: (handover: app), acc: (handover: app), tx: (handover: app), net: (handover: app), "
    "app: (worker_threads: {threads}))"
)
# All that Zenoh does in one thread: several wake each other for every message, which costs a fifth of all slots a
# second. Nothing waits there: what can block is sent by this program's threads. Read when the first session is opened.
os.environ.setdefault(RUNTIME, HANDOVER.format(threads=1))

MAX_MESSAGE_BYTES = 16 * 2**20
FIRST_ATTEMPT_S = 2.0
"""After this time without a link it is asked whether a certificate is the reason. [s]"""


def open_clock(
    run: str, endpoint: str = DEFAULT_ENDPOINT, *, certs: Path | None = None, insecure: bool = False
) -> zenoh.Session:
    """Open the hub that every agent connects to.

    Parameters
    ----------
    run:
        Name of the market: the access list holds for its keys.
    certs:
        Folder of certificates; without it nobody is authenticated.

    Raises
    ------
    BusError
        Where the endpoint is not on loopback and neither ``certs`` nor ``insecure`` is given, or cannot be listened on.
    SecurityError
        Where certificates are missing.
    """
    credentials = None if certs is None else Credentials(certs, CLOCK)
    endpoint = secured(endpoint, credentials)
    if credentials is None and not insecure and not is_loopback_endpoint(endpoint):
        raise BusError(
            f"endpoint = {endpoint}: only loopback is allowed without authentication, such as {DEFAULT_ENDPOINT}; "
            "give certificates with --certs (zengrid certs makes them), or pass --insecure to let anyone who reaches "
            "this address take part"
        )
    guarded: dict[str, Any] = {}
    if credentials is not None:
        from zengrid.bus.access_list import AccessList, limits  # two megabytes, and only the clock has a list

        guarded = {**credentials.settings(), **limits(AccessList.load(credentials.folder), run)}
    return _open(
        {
            **guarded,
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


def open_client(
    endpoint: str = DEFAULT_ENDPOINT, *, credentials: Credentials | None = None, timeout_s: float = 30.0
) -> zenoh.Session:
    """Open an agent's or operator's session; waits until the clock (or a router) can be reached.

    Raises
    ------
    BusError
        Where nobody listens on the endpoint within the time.
    SecurityError
        Where one side does not accept the other's certificate.
    """
    endpoint = secured(endpoint, credentials)
    if credentials is None:
        return _connect(endpoint, {}, timeout_s)
    until = time.monotonic() + timeout_s
    try:
        return _connect(endpoint, credentials.settings(), min(timeout_s, FIRST_ATTEMPT_S))
    except BusError:
        # Zenoh does not tell a refused certificate from a dead endpoint, and waiting mends only the latter.
        refusal = credentials.refusal(endpoint)
        if refusal is not None:
            raise SecurityError(refusal) from None
        left_s = until - time.monotonic()
        if left_s <= 0:
            raise
        return _connect(endpoint, credentials.settings(), left_s)


def _connect(endpoint: str, security: dict[str, Any], timeout_s: float) -> zenoh.Session:
    return _open(
        {
            **security,
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
