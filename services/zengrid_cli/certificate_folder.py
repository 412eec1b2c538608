"""The folder of certificates that ``zengrid certs`` makes and renews."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from zengrid.bus.access_list import AccessList, write_router
from zengrid.bus.certificates import LOCAL_HOSTS, Authority, days_left, hosts_of, read_certificate
from zengrid.bus.credentials import AUTHORITY, CLOCK, RESERVED_NAMES, ROUTER
from zengrid.errors import SecurityError
from zengrid.scenario import load

if TYPE_CHECKING:
    from cryptography.x509 import Certificate

GRID = "grid"
RENEW_BEFORE_DAYS = 30
"""A certificate that is valid for fewer days than this is reported. [d]"""


def update_folder(options: argparse.Namespace) -> list[str]:
    """Make what is missing in the folder; return one line for each file that is new, renewed or about to expire.

    Raises
    ------
    SecurityError
        If the folder cannot be made, or a name cannot be added or revoked.
    """
    folder: Path = options.folder
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    except OSError as error:
        raise SecurityError(f"{folder}: {error.strerror}") from None
    exists = (folder / f"{AUTHORITY}.pem").exists()
    authority = Authority(folder) if exists else Authority.make(folder, "zengrid")
    names = AccessList.load(folder) if exists and (folder / "access.json").exists() else AccessList()
    _add(names, options)
    _revoke(names, options.revoke)
    kind = "the authority" if exists else "a new authority"
    lines = [f"{folder}/{AUTHORITY}.pem: {kind}, {_validity(authority.certificate)}"]
    for name in (CLOCK, ROUTER, *names.operators, *names.spawners, *names.agents):
        line = _provide(authority, name, options)
        if line is not None:
            lines.append(line)
    # Last, so that the list has no name without a certificate.
    names.save(folder)
    if options.router is not None:
        path = write_router(folder, names, options.run, options.router)
        lines.append(f"{path}: for zenohd -c {path.name}, in a folder with ca.pem, router.pem and router.key")
    count = f"{len(names.agents)} agent{'' if len(names.agents) == 1 else 's'}"
    lines.append(f"{folder}/access.json: {count}; a running clock reads it at its next start")
    return lines


def _add(names: AccessList, options: argparse.Namespace) -> None:
    """Put the requested names on the access list."""
    wanted = [GRID, *options.ids]
    if options.scenario is not None:
        wanted += [agent.id for agent in load(options.scenario, data=options.data).agents]
    _extend(names, names.agents, wanted, but=names.spawners)
    _extend(names, names.agents, _spare({*names.agents, *names.revoked}, options.spare), but=names.spawners)
    _extend(names, names.spawners, options.spawner, but=names.agents)


def _extend(names: AccessList, listed: list[str], wanted: Iterable[str], but: list[str]) -> None:
    for name in wanted:
        if name in names.revoked:
            raise SecurityError(
                f"id = {name}: was revoked, and its old certificate would be valid again; choose another name"
            )
        if name in but or name in RESERVED_NAMES:
            raise SecurityError(f"id = {name}: has another role already; an agent and a spawner cannot share a name")
        if name not in listed:
            listed.append(name)


def _spare(taken: set[str], count: int) -> Iterator[str]:
    """The next free names of the form p1, p2, ..."""
    number = 0
    while count:
        number += 1
        if f"p{number}" not in taken:
            count -= 1
            yield f"p{number}"


def _revoke(names: AccessList, ids: Sequence[str]) -> None:
    for name in ids:
        listed = next((one for one in (names.agents, names.spawners) if name in one), None)
        if listed is None:
            raise SecurityError(f"--revoke {name}: not on the list, which has {', '.join(names.agents[:20])}")
        if name == GRID:
            raise SecurityError("--revoke grid: a market needs its grid agent; start a new folder instead")
        listed.remove(name)
        names.revoked.append(name)


def _provide(authority: Authority, name: str, options: argparse.Namespace) -> str | None:
    """Make a certificate if one is needed; return a line about what was done, or should be done."""
    path = authority.folder / f"{name}.pem"
    old = read_certificate(path) if path.exists() else None
    serves = name in (CLOCK, ROUTER)
    hosts = tuple(dict.fromkeys((*(hosts_of(old) if old else ()), *LOCAL_HOSTS, *options.host))) if serves else None
    where = f", reached as {', '.join(hosts)}" if hosts else ""
    if old is None:
        return f"{path}: new, {_validity(authority.issue(name, options.days, hosts))}{where}"
    if options.renew or (hosts is not None and hosts != hosts_of(old)):
        return f"{path}: renewed, {_validity(authority.issue(name, options.days, hosts))}{where}"
    if days_left(old) < RENEW_BEFORE_DAYS:
        return f"{path}: {_validity(old)}: make new ones with --renew"
    return None


def _validity(certificate: Certificate) -> str:
    word = "valid until" if days_left(certificate) > 0 else "EXPIRED on"
    return f"{word} {certificate.not_valid_after_utc:%Y-%m-%d}"
