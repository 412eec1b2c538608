"""Who a process is on the bus: its certificate, its key, and the authority that all sides trust."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from zengrid.errors import SecurityError

CLOCK, ROUTER, GATEWAY, OPERATOR, SPAWNER = "clock", "router", "gateway", "operator", "spawner"
"""Certificates of those who are not agents; an agent's certificate has the name of the agent."""
AUTHORITY = "ca"
RESERVED_NAMES = (AUTHORITY, CLOCK, ROUTER, GATEWAY, OPERATOR)
"""Names of roles, which no agent and no spawner may have."""
PROTOCOLS = ("tls", "quic")
"""Links on which both sides show a certificate."""
PROBE_S = 2.0
"""Longest wait for what the other side says to a certificate. [s]"""


@dataclass(frozen=True, slots=True)
class Credentials:
    """One certificate of a folder made by ``zengrid certs``.

    Parameters
    ----------
    folder:
        Holds ``ca.pem``, and ``NAME.pem`` and ``NAME.key`` of whoever runs here.
    name:
        The common name of the certificate: an agent's id, or a role.

    Raises
    ------
    SecurityError
        Where one of the three files is missing or cannot be read.
    """

    folder: Path
    name: str

    def __post_init__(self) -> None:
        for path in (self.authority, self.certificate, self.key):
            try:
                path.read_bytes()
            except FileNotFoundError:
                raise SecurityError(
                    f"{path}: no such file; {self.name} needs {AUTHORITY}.pem, {self.name}.pem and {self.name}.key "
                    f"there (zengrid certs {self.folder} makes them)"
                ) from None
            except OSError as error:
                raise SecurityError(f"{path}: {error.strerror}") from None

    @property
    def authority(self) -> Path:
        """The certificate of the authority that signed all others."""
        return self.folder / f"{AUTHORITY}.pem"

    @property
    def certificate(self) -> Path:
        """Says who this is."""
        return self.folder / f"{self.name}.pem"

    @property
    def key(self) -> Path:
        """Proves it."""
        return self.folder / f"{self.name}.key"

    def settings(self) -> dict[str, Any]:
        """Zenoh's settings, to listen and to connect with this certificate."""
        tls = "transport/link/tls"
        certificate, key = str(self.certificate), str(self.key)
        return {
            f"{tls}/root_ca_certificate": str(self.authority),
            f"{tls}/enable_mtls": True,
            f"{tls}/listen_certificate": certificate,
            f"{tls}/listen_private_key": key,
            f"{tls}/connect_certificate": certificate,
            f"{tls}/connect_private_key": key,
            # A link does not outlive the certificate that it was opened with.
            f"{tls}/close_link_on_expiration": True,
        }

    def refusal(self, endpoint: str) -> str | None:
        """Why two sides do not accept each other's certificate; None where that is not what keeps them apart."""
        # Wanted only where no link comes about, and a megabyte in each process.
        import socket
        import ssl

        host, port = address_of(endpoint)
        try:
            context = ssl.create_default_context(cafile=self.authority)
            context.load_cert_chain(self.certificate, self.key)
            with (
                socket.create_connection((host, port), PROBE_S) as link,
                context.wrap_socket(link, server_hostname=host) as secured,
            ):
                # The other side judges our certificate only after we have taken its own.
                secured.settimeout(PROBE_S)
                secured.recv(1)
        except ssl.SSLCertVerificationError as error:
            return f"the certificate of {endpoint} is not accepted here: {error.verify_message}"
        except ssl.SSLError as error:
            reason = (error.reason or str(error)).lower().replace("_", " ")
            return f"{self.certificate} is not accepted by {endpoint}: {reason}"
        except OSError:
            return None
        return None


def secured(endpoint: str, credentials: Credentials | None) -> str:
    """The endpoint as it is used: with certificates ``tcp/...`` means ``tls/...``.

    Raises
    ------
    SecurityError
        Where the protocol does not fit.
    """
    protocol, _, address = endpoint.partition("/")
    if credentials is None:
        if protocol in PROTOCOLS:
            raise SecurityError(f"endpoint = {endpoint}: {protocol} needs certificates; give their folder with --certs")
        return endpoint
    if protocol == "tcp":
        return f"tls/{address}"
    if protocol not in PROTOCOLS:
        raise SecurityError(f"endpoint = {endpoint}: permitted with certificates: tls/HOST:PORT, quic/HOST:PORT")
    return endpoint


def address_of(endpoint: str) -> tuple[str, int]:
    """Host and port of an endpoint such as ``tls/192.0.2.10:7447``."""
    address = endpoint.partition("/")[2].partition("#")[0].partition("?")[0]
    host, _, port = address.rpartition(":")
    return host.strip("[]"), int(port)
