"""Endpoints and ports on this machine: checks that they are free, or finds free ones."""

from __future__ import annotations

import socket

from zengrid.errors import BusError

AUTO = "auto"


def choose_endpoint(wanted: str) -> str:
    """The Zenoh endpoint to listen on; ``auto`` finds a free port on loopback.

    Raises
    ------
    BusError
        If another process listens there.
    """
    if wanted == AUTO:
        return f"tcp/127.0.0.1:{free_port()}"
    protocol, _, address = wanted.partition("/")
    host, colon, port = address.rpartition(":")
    if protocol not in ("tcp", "tls") or not colon or not port.isdecimal():
        return wanted  # Zenoh checks all other protocols.
    if not is_free(host.strip("[]"), int(port)):
        raise BusError(
            f"--listen {wanted}: another process listens there, such as another market; "
            f"choose another port, or --listen {AUTO} for any free one"
        )
    return wanted


def choose_http_port(wanted: int | None, usual: int) -> int:
    """The port for HTTP on loopback: the wanted one, else the usual one, or any other if that is in use.

    Raises
    ------
    BusError
        If the wanted port is in use.
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
        return True  # Zenoh reports a name that does not resolve.
    family, kind, protocol, _, address = found[0]
    with socket.socket(family, kind, protocol) as probe:
        # As servers do: a connection that has just ended does not keep the port in use.
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
    """A port on loopback that no process uses."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
