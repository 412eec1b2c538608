"""``zengrid certs``: an authority, and certificates for the clock, for all who steer, and for agents ahead of time."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from zengrid.bus.access_list import AccessList, write_router
from zengrid.bus.credentials import AUTHORITY, CLOCK, GATEWAY, OPERATOR, ROUTER, SPAWNER
from zengrid.bus.keys import DEFAULT_RUN
from zengrid.errors import SecurityError
from zengrid_cli.options import parse_count

if TYPE_CHECKING:
    from cryptography.x509 import Certificate

    from zengrid.bus.certificates import Authority

GRID = "grid"
RESERVED = (AUTHORITY, CLOCK, ROUTER, GATEWAY, OPERATOR)
"""AccessList of roles, which no agent and no spawner may have."""
SOON_DAYS = 30
_ID = re.compile(r"[a-z0-9][a-z0-9_-]{0,62}")


def parse_days(text: str) -> int:
    """A validity, up to ten years. [d]"""
    if not text.isdecimal() or not 1 <= int(text) <= 3650:
        raise argparse.ArgumentTypeError(f"days = {text}: permitted: 1 to 3650")
    return int(text)


def parse_ids(text: str) -> list[str]:
    """AccessList with commas between them."""
    ids = text.split(",")
    for name in ids:
        if not _ID.fullmatch(name):
            raise argparse.ArgumentTypeError(
                f"id = {name}: permitted: 1 to 63 of a-z, 0-9, _ and -, not beginning with a sign"
            )
        if name in RESERVED:
            raise argparse.ArgumentTypeError(
                f"id = {name}: is the name of a role; not permitted: {', '.join(RESERVED)}"
            )
    return ids


def parser() -> argparse.ArgumentParser:
    """The command line."""
    it = argparse.ArgumentParser(
        prog="zengrid certs",
        description="Make certificates: an authority, the clock, gateway, spawner and operator, and agents. "
        "Run it again to add names or to renew; keys that are there are never replaced.",
    )
    it.add_argument("folder", type=Path, help="where they are kept; made if need be")
    agents = it.add_argument_group("agents")
    agents.add_argument("--scenario", help="the agents of this scenario, built-in or YAML file")
    agents.add_argument("--data", type=Path, help="folder with the scenario's measured data")
    agents.add_argument("--ids", type=parse_ids, default=[], metavar="ID,...", help="agents of these names")
    agents.add_argument(
        "--spare",
        type=parse_count,
        default=0,
        metavar="N",
        help="so many more, called p1, p2, ...: for homes that come later",
    )
    agents.add_argument(
        "--revoke", type=parse_ids, default=[], metavar="ID,...", help="take these names off the access list, for good"
    )
    others = it.add_argument_group("the rest")
    others.add_argument(
        "--host",
        action="append",
        default=[],
        metavar="ADDRESS",
        help="name or address under which others reach the clock or a router; may be repeated",
    )
    others.add_argument(
        "--spawner", type=parse_ids, default=[SPAWNER], metavar="NAME,...", help="spawners (default: spawner)"
    )
    others.add_argument(
        "--days", type=parse_days, default=365, metavar="N", help="validity (default: %(default)s days)"
    )
    others.add_argument(
        "--router",
        metavar="ENDPOINT",
        help="also write router.json5, the configuration of a Zenoh router in front of the clock that listens there",
    )
    others.add_argument(
        "--run", default=DEFAULT_RUN, metavar="NAME", help="the market it is for (default: %(default)s)"
    )
    others.add_argument("--renew", action="store_true", help="new certificates for all names, with the keys they have")
    return it


def main(arguments: Sequence[str]) -> int:
    """Make what is missing, and say what there is; returns the exit code."""
    options = parser().parse_args(arguments)
    from zengrid.bus.certificates import Authority

    folder: Path = options.folder
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    except OSError as error:
        raise SecurityError(f"{folder}: {error.strerror}") from None
    begun = (folder / f"{AUTHORITY}.pem").exists()
    authority = Authority(folder) if begun else Authority.make(folder, "zengrid")
    names = AccessList.load(folder) if begun and (folder / "access.json").exists() else AccessList()
    _add(names, options)
    _revoke(names, options.revoke)
    print(
        f"{folder}/{AUTHORITY}.pem: {'the authority' if begun else 'a new authority'}, {_until(authority.certificate)}"
    )
    for name in (CLOCK, ROUTER, *names.operators, *names.spawners, *names.agents):
        said = _provide(authority, name, options, names)
        if said:
            print(said)
    # Last, so that the list names nobody who has no certificate.
    names.save(folder)
    if options.router is not None:
        path = write_router(folder, names, options.run, options.router)
        print(f"{path}: for zenohd -c {path.name}, in a folder with ca.pem, router.pem and router.key")
    count = f"{len(names.agents)} agent{'' if len(names.agents) == 1 else 's'}"
    print(f"{folder}/access.json: {count}; a clock that runs reads it when it is started again")
    return 0


def _add(names: AccessList, options: argparse.Namespace) -> None:
    """Put all that are asked for on the access list."""
    wanted = [GRID, *options.ids]
    if options.scenario is not None:
        from zengrid.scenario import load

        wanted += [agent.id for agent in load(options.scenario, data=options.data).agents]
    _extend(names, names.agents, wanted, but=names.spawners)
    _extend(names, names.agents, _spare({*names.agents, *names.revoked}, options.spare), but=names.spawners)
    _extend(names, names.spawners, options.spawner, but=names.agents)


def _extend(names: AccessList, listed: list[str], wanted: Iterable[str], but: list[str]) -> None:
    for name in wanted:
        if name in names.revoked:
            raise SecurityError(
                f"id = {name}: was revoked, and its old certificate would be good again; choose another name"
            )
        if name in but or name in RESERVED:
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
            raise SecurityError("--revoke grid: a market needs its grid agent; begin a new folder instead")
        listed.remove(name)
        names.revoked.append(name)


def _provide(authority: Authority, name: str, options: argparse.Namespace, names: AccessList) -> str | None:
    """Make a certificate where one is needed; tells what was done, or is to be done."""
    from zengrid.bus.certificates import LOCAL_HOSTS, days_left, hosts_of, read_certificate

    path = authority.folder / f"{name}.pem"
    old = read_certificate(path) if path.exists() else None
    serves = name in (CLOCK, ROUTER)
    hosts = tuple(dict.fromkeys((*(hosts_of(old) if old else ()), *LOCAL_HOSTS, *options.host))) if serves else None
    where = f", reached as {', '.join(hosts)}" if hosts else ""
    if old is None:
        return f"{path}: new, {_until(authority.issue(name, options.days, hosts))}{where}"
    if options.renew or (hosts is not None and hosts != hosts_of(old)):
        return f"{path}: renewed, {_until(authority.issue(name, options.days, hosts))}{where}"
    if days_left(old) < SOON_DAYS:
        return f"{path}: {_until(old)}: make new ones with --renew"
    return None


def _until(certificate: Certificate) -> str:
    from zengrid.bus.certificates import days_left

    word = "valid until" if days_left(certificate) > 0 else "EXPIRED on"
    return f"{word} {certificate.not_valid_after_utc:%Y-%m-%d}"
