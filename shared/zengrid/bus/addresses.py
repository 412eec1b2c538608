"""Endpoints and addresses on the bus, for those who need no Zenoh."""

from __future__ import annotations

import ipaddress
from functools import lru_cache

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"


@lru_cache(maxsize=1000)
def is_loopback(host: str) -> bool:
    """Whether an address or host name can only be reached from this machine."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def is_loopback_endpoint(endpoint: str) -> bool:
    """Whether a Zenoh endpoint such as ``tcp/127.0.0.1:7447`` can only be reached from this machine."""
    protocol, _, address = endpoint.partition("/")
    if protocol == "unixsock-stream":
        return True
    return is_loopback(address.rpartition(":")[0].strip("[]"))
