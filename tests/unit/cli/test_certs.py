"""``zengrid certs``: nothing that exists is lost, and what is wrong is said."""

from __future__ import annotations

import stat
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.x509.oid import ExtendedKeyUsageOID

from zengrid.bus.access_list import AccessList
from zengrid.bus.certificates import Authority, days_left, hosts_of, read_certificate
from zengrid.bus.clock_link import ClockLink
from zengrid.bus.credentials import Credentials, secured
from zengrid.errors import BusError, SecurityError
from zengrid_cli.commands.certs_command import main


def contents(folder: Path, pattern: str) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.glob(pattern)}


def test_everyone_of_a_scenario_gets_a_certificate_and_a_key_that_only_its_owner_reads(tmp_path: Path) -> None:
    folder = tmp_path / "certs"
    assert main([str(folder), "--scenario", "paper", "--spare", "2", "--host", "192.0.2.10"]) == 0
    names = AccessList.load(folder)
    assert names.agents == ["grid", "p1", "p2", "p3", "p4", "p5"]
    assert names.spawners == ["spawner"]
    assert {path.stem for path in folder.glob("*.key")} == {
        "ca", "clock", "router", *names.operators, *names.spawners, *names.agents,
    }  # fmt: skip
    assert {stat.S_IMODE(path.stat().st_mode) for path in folder.glob("*.key")} == {0o600}
    authority = read_certificate(folder / "ca.pem")
    for name in ("clock", "p1"):
        certificate = read_certificate(folder / f"{name}.pem")
        certificate.verify_directly_issued_by(authority)
        assert certificate.subject.rfc4514_string() == f"CN={name}"
        purposes = certificate.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value
        assert (ExtendedKeyUsageOID.SERVER_AUTH in purposes) == (name == "clock"), "an agent must not pose as the clock"
    assert hosts_of(read_certificate(folder / "clock.pem")) == ("localhost", "127.0.0.1", "::1", "192.0.2.10")


def test_names_and_hosts_are_added_and_keys_are_never_replaced(tmp_path: Path) -> None:
    main([str(tmp_path), "--ids", "p1", "--days", "90"])
    keys, certificates = contents(tmp_path, "*.key"), contents(tmp_path, "*.pem")
    assert main([str(tmp_path), "--ids", "p1,heat-pump", "--host", "clock.example"]) == 0
    assert contents(tmp_path, "*.key").items() >= keys.items()
    changed = {name for name, was in certificates.items() if contents(tmp_path, "*.pem")[name] != was}
    assert changed == {"clock.pem", "router.pem"}
    assert hosts_of(read_certificate(tmp_path / "clock.pem"))[-1] == "clock.example"
    # The key of an agent on another machine is not here any more: its certificate can be renewed all the same.
    (tmp_path / "p1.key").unlink()
    assert main([str(tmp_path), "--renew", "--days", "400"]) == 0
    assert not (tmp_path / "p1.key").exists()
    renewed = read_certificate(tmp_path / "p1.pem")
    assert renewed.public_key() == x509.load_pem_x509_certificate(certificates["p1.pem"]).public_key()
    assert 399 < days_left(renewed) < 401


def test_what_was_revoked_stays_revoked(tmp_path: Path) -> None:
    main([str(tmp_path), "--ids", "p1,p2"])
    assert main([str(tmp_path), "--revoke", "p1"]) == 0
    assert AccessList.load(tmp_path).agents == ["grid", "p2"]
    with pytest.raises(SecurityError, match="id = p1: was revoked"):
        main([str(tmp_path), "--ids", "p1"])
    assert main([str(tmp_path), "--spare", "1"]) == 0
    assert AccessList.load(tmp_path).agents == ["grid", "p2", "p3"]


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--ids", "clock"], "id = clock: is the name of a role"),
        (["--ids", "P 1"], "id = P 1: permitted: 1 to 63 of"),
        (["--days", "0"], "days = 0: permitted: a whole number 1 to 3650"),
    ],
)
def test_wrong_names_are_refused(
    words: list[str], complaint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main([str(tmp_path / "certs"), *words])
    assert complaint in capsys.readouterr().err
    assert not (tmp_path / "certs").exists()


def test_what_is_broken_is_named(tmp_path: Path) -> None:
    main([str(tmp_path), "--ids", "p1"])
    with pytest.raises(SecurityError, match=r"ca\.key: is there already, and is not replaced"):
        Authority.make(tmp_path, "zengrid")
    with pytest.raises(SecurityError, match=r"p9\.pem: no such file; p9 needs ca\.pem, p9\.pem and p9\.key there"):
        Credentials(tmp_path, "p9")
    with pytest.raises(SecurityError, match="host = häuser: permitted"):
        main([str(tmp_path), "--host", "häuser"])
    (tmp_path / "access.json").write_text('{"agents": ["P1"]}')
    with pytest.raises(SecurityError, match=r"access\.json: agents\.0"):
        main([str(tmp_path)])
    (tmp_path / "ca.key").write_text("nothing")
    with pytest.raises(SecurityError, match=r"ca\.key: holds no private key"):
        main([str(tmp_path)])


def test_endpoints_say_whether_certificates_are_used(tmp_path: Path) -> None:
    main([str(tmp_path), "--ids", "p1"])
    p1 = Credentials(tmp_path, "p1")
    assert secured("tcp/127.0.0.1:7447", p1) == "tls/127.0.0.1:7447"
    assert secured("quic/127.0.0.1:7447", p1) == "quic/127.0.0.1:7447"
    assert secured("tcp/127.0.0.1:7447", None) == "tcp/127.0.0.1:7447"
    with pytest.raises(SecurityError, match=r"tls needs certificates; give their folder with --certs"):
        secured("tls/127.0.0.1:7447", None)
    with pytest.raises(SecurityError, match=r"permitted with certificates: tls/HOST:PORT, quic/HOST:PORT"):
        secured("udp/127.0.0.1:7447", p1)


@pytest.mark.parametrize("endpoint", ["tcp/0.0.0.0:0", "tcp/[::]:0", "tcp/192.0.2.10:7447", "udp/clock.example:7447"])
def test_nobody_beyond_this_machine_is_let_in_without_certificates(endpoint: str) -> None:
    with pytest.raises(BusError, match="only loopback is allowed without authentication"):
        ClockLink("main", endpoint)
