"""Makes certificates: an authority, and for each name a key and what the authority says of it."""

from __future__ import annotations

import datetime as dt
import ipaddress
import os
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TypeVar

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from zengrid.bus.credentials import AUTHORITY
from zengrid.errors import SecurityError

AUTHORITY_DAYS = 3653
LOCAL_HOSTS = ("localhost", "127.0.0.1", "::1")
T = TypeVar("T")
PRIVATE, PUBLIC = 0o600, 0o644
_EARLIER = dt.timedelta(minutes=5)
"""Clocks of other machines may be behind by so much."""


class Authority:
    """Signs certificates. Its key belongs to no machine that runs a market.

    Parameters
    ----------
    folder:
        Holds ``ca.pem`` and ``ca.key``, and all that is signed.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.certificate = read_certificate(folder / f"{AUTHORITY}.pem")
        self._key = _read_key(folder / f"{AUTHORITY}.key")
        if self._key.public_key() != self.certificate.public_key():
            raise SecurityError(f"{folder}/{AUTHORITY}.key: does not belong to {AUTHORITY}.pem")

    @classmethod
    def make(cls, folder: Path, name: str) -> Authority:
        """Make a new authority.

        Raises
        ------
        SecurityError
            Where the folder has one already, or cannot be written.
        """
        key = _new_key(folder / f"{AUTHORITY}.key")
        subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
        usage = _usage(digital_signature=False, sign_certificates=True)
        built = _builder(subject, subject, key.public_key(), AUTHORITY_DAYS)
        built = built.add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        built = built.add_extension(usage, critical=True)
        built = built.add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
        _write(folder / f"{AUTHORITY}.pem", _pem(built.sign(key, hashes.SHA256())), PUBLIC)
        return cls(folder)

    def issue(self, name: str, days: int, hosts: Sequence[str] | None = None) -> x509.Certificate:
        """Make a certificate for a name, and a key where it has none; an earlier certificate is replaced.

        Parameters
        ----------
        name:
            Its common name.
        days:
            How long it is valid, at most as long as the authority.
        hosts:
            Names and addresses under which it can be reached; None for those to whom nobody connects.

        Raises
        ------
        SecurityError
            Where a file cannot be read or written, or a host is neither a name nor an address.
        """
        path = self.folder / f"{name}.pem"
        built = _builder(
            x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)]),
            self.certificate.subject,
            self._public_key_of(name),
            days,
            until=self.certificate.not_valid_after_utc,
        )
        purposes = [ExtendedKeyUsageOID.CLIENT_AUTH]
        if hosts is not None:
            # Only with this purpose can one listen: an agent's certificate must not do for a false clock.
            purposes.append(ExtendedKeyUsageOID.SERVER_AUTH)
            built = built.add_extension(x509.SubjectAlternativeName(_names(hosts)), critical=False)
        issuer = self.certificate.extensions.get_extension_for_class(x509.SubjectKeyIdentifier).value
        built = built.add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        built = built.add_extension(_usage(digital_signature=True, sign_certificates=False), critical=True)
        built = built.add_extension(x509.ExtendedKeyUsage(purposes), critical=False)
        built = built.add_extension(
            x509.AuthorityKeyIdentifier.from_issuer_subject_key_identifier(issuer), critical=False
        )
        certificate = built.sign(self._key, hashes.SHA256())
        _write(path, _pem(certificate), PUBLIC, replace=True)
        return certificate

    def _public_key_of(self, name: str) -> ec.EllipticCurvePublicKey:
        """Of the key in the folder, of the certificate whose key has been moved to its machine, or a new one."""
        key, certificate = self.folder / f"{name}.key", self.folder / f"{name}.pem"
        if key.exists():
            return _read_key(key).public_key()
        if certificate.exists():
            public = read_certificate(certificate).public_key()
            assert isinstance(public, ec.EllipticCurvePublicKey)
            return public
        return _new_key(key).public_key()


def read_certificate(path: Path) -> x509.Certificate:
    """Read a certificate; raises SecurityError where it is none."""
    return _read(path, x509.load_pem_x509_certificate, "certificate")


def hosts_of(certificate: x509.Certificate) -> tuple[str, ...]:
    """Names and addresses under which its owner can be reached."""
    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return ()
    return tuple(str(name.value) for name in names)


def days_left(certificate: x509.Certificate) -> float:
    """How long it is still valid; negative afterwards. [d]"""
    return (certificate.not_valid_after_utc - dt.datetime.now(dt.UTC)) / dt.timedelta(days=1)


def _builder(
    subject: x509.Name,
    issuer: x509.Name,
    key: ec.EllipticCurvePublicKey,
    days: int,
    until: dt.datetime | None = None,
) -> x509.CertificateBuilder:
    now = dt.datetime.now(dt.UTC)
    end = now + dt.timedelta(days=days)
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - _EARLIER)
        .not_valid_after(end if until is None else min(end, until))
    )


def _usage(*, digital_signature: bool, sign_certificates: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=digital_signature, key_cert_sign=sign_certificates, crl_sign=sign_certificates,
        content_commitment=False, key_encipherment=False, data_encipherment=False, key_agreement=False,
        encipher_only=False, decipher_only=False,
    )  # fmt: skip


def _names(hosts: Iterable[str]) -> list[x509.GeneralName]:
    found: list[x509.GeneralName] = []
    for host in hosts:
        try:
            found.append(x509.IPAddress(ipaddress.ip_address(host)))
        except ValueError:
            try:
                found.append(x509.DNSName(host))
            except ValueError:
                raise SecurityError(f"host = {host}: permitted: an address, or a name in ASCII") from None
    return found


def _new_key(path: Path) -> ec.EllipticCurvePrivateKey:
    key = ec.generate_private_key(ec.SECP256R1())
    pkcs8 = serialization.PrivateFormat.PKCS8
    _write(path, key.private_bytes(serialization.Encoding.PEM, pkcs8, serialization.NoEncryption()), PRIVATE)
    return key


def _read_key(path: Path) -> ec.EllipticCurvePrivateKey:
    key = _read(path, lambda pem: serialization.load_pem_private_key(pem, password=None), "private key")
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise SecurityError(f"{path}: permitted: a key of an elliptic curve")
    return key


def _read(path: Path, load: Callable[[bytes], T], what: str) -> T:
    try:
        return load(path.read_bytes())
    except FileNotFoundError:
        raise SecurityError(f"{path}: no such file") from None
    except OSError as error:
        raise SecurityError(f"{path}: {error.strerror}") from None
    except (ValueError, TypeError):
        raise SecurityError(f"{path}: holds no {what} in PEM without a password") from None


def _pem(certificate: x509.Certificate) -> bytes:
    return certificate.public_bytes(serialization.Encoding.PEM)


def _write(path: Path, data: bytes, mode: int, *, replace: bool = False) -> None:
    """Write a file that is either complete or not there; one that is there is replaced only where that is meant."""
    new = path.with_name(f".{path.name}.new")
    try:
        new.unlink(missing_ok=True)
        with os.fdopen(os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        if replace:
            new.replace(path)
        else:
            # Unlike a rename a link never replaces what is there.
            os.link(new, path)
            new.unlink()
    except FileExistsError:
        new.unlink(missing_ok=True)
        raise SecurityError(f"{path}: is there already, and is not replaced") from None
    except OSError as error:
        raise SecurityError(f"{path}: {error.strerror}") from None
