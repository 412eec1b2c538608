"""Where a market listens on this machine: checks that it is free, or finds a place that is."""

from __future__ import annotations

import socket

from zengrid.errors import BusError

AUTO = "auto"


def choose_endpoint(wanted: str) -> str:
    """The Zenoh endpoint to listen on; ``auto`` finds a free port on loopback.

    Raises
    ------
    BusError
        Where another process listens there already.
    """
    if wanted == AUTO:
        return f"tcp/127.0.0.1:{free_port()}"
    protocol, _, address = wanted.partition("/")
    host, colon, port = address.rpartition(":")
    if protocol not in ("tcp", "tls") or not colon or not port.isdecimal():
        return wanted  # Whatever it is, Zenoh knows more of it.
    if not is_free(host.strip("[]"), int(port)):
        raise BusError(
            f"--listen {wanted}: another process listens there, such as a market that runs already; "
            f"choose another port, or --listen {AUTO} for any free one"
        )
    return wanted


def choose_http_port(wanted: int | None, usual: int) -> int:
    """The port for HTTP on loopback: the wanted one, else the usual one, or any other if that is taken.

    Raises
    ------
    BusError
        Where the wanted one is taken.
    """
    if is_free("127.0.0.1", wanted or usual):
        return wanted or usual
    if wanted is not None:
        raise BusError(f"--http {wanted}: another process listens there; choose another port, or --no-http")
    return free_port()


def is_free(host: str, port: int) -> bool:
    """Whether a process could listen there."""
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    except socket.gaierror:
        return True  # A name that does not resolve is for Zenoh to complain about.
    family, kind, protocol, _, address = found[0]
    with socket.socket(family, kind, protocol) as probe:
        # As a server does: a connection that ended a moment ago is no obstacle.
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(address)
            probe.listen(1)
        except PermissionError:
            return True
        except OSError as error:
            import errno

            return error.errno != errno.EADDRINUSE
    return True


def free_port() -> int:
    """A port on loopback that nobody uses now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
