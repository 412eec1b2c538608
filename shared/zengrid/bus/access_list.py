"""Who may do what on the bus: Zenoh's access list, made from the names that have a certificate.

Everything is forbidden that is not permitted here. Zenoh says nothing to whoever tries: what is put goes nowhere, a
subscription stays empty, a question gets no answer.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from zengrid.bus.credentials import AUTHORITY, CLOCK, GATEWAY, OPERATOR, ROUTER
from zengrid.bus.keys import KeyExpressions
from zengrid.errors import SecurityError
from zengrid.validation import first_error
from zengrid.wire.base import AgentId

FILE = "access.json"
SEE = ("declare_liveliness_subscriber", "liveliness_query")
READ = ("declare_subscriber",)
SERVE = ("declare_queryable", "reply")
EVERYTHING = (
    "put", "delete", "declare_subscriber", "query", "declare_queryable", "reply", "liveliness_token",
    "liveliness_query", "declare_liveliness_subscriber",
)  # fmt: skip

QUESTION_BYTES = 4096
"""Largest question of an operator, or to leave. [byte]"""
ACTION_BYTES = 4 * 2**20
"""Largest action: of the largest fleet. [byte]"""
ACTIONS_HZ = 2000.0
"""Most actions of one process that are looked at; a market at full speed has about 1000 slots a second. [1/s]"""
JOINS_HZ = 20.0
LOOKS_HZ = 500.0
"""Most questions of one process that are heard: to join, to leave, and for the scenario; for the last slot. [1/s]

What comes sooner after the one before is dropped without a word, and whoever asked waits in vain. So questions that
only operators may ask are not limited here: the clock's queue has an end of its own, and says so.
"""

Rule = dict[str, Any]


class AccessList(BaseModel):
    """Whom the clock knows: ``access.json`` in the folder of certificates."""

    model_config = ConfigDict(extra="forbid", strict=True)

    v: Literal[1] = 1
    agents: list[AgentId] = Field(default_factory=list)
    spawners: list[AgentId] = Field(default_factory=list)
    operators: list[AgentId] = Field(default_factory=lambda: [OPERATOR, GATEWAY])
    revoked: list[AgentId] = Field(default_factory=list, description="Had a certificate, and may not have another.")

    @classmethod
    def load(cls, folder: Path) -> Self:
        """Read the names.

        Raises
        ------
        SecurityError
            Where the file is missing or wrong.
        """
        path = folder / FILE
        try:
            return cls.model_validate_json(path.read_bytes())
        except FileNotFoundError:
            raise SecurityError(f"{path}: no such file; zengrid certs {folder} makes it") from None
        except OSError as error:
            raise SecurityError(f"{path}: {error.strerror}") from None
        except ValidationError as error:
            raise SecurityError(f"{path}: {first_error(error)}") from None

    def save(self, folder: Path) -> None:
        """Write the names in one step."""
        path = folder / FILE
        new = path.with_suffix(".new")
        new.write_text(json.dumps(self.model_dump(), indent=2) + "\n")
        os.replace(new, path)  # noqa: PTH105 - says what it does

    @property
    def sessions(self) -> int:
        """Most sessions at a time: some for each name, since operators look from several places at once."""
        return 64 + 2 * (len(self.agents) + len(self.spawners)) + 16 * len(self.operators)


def write_router(folder: Path, names: AccessList, run: str, clock: str, listen: str = "tls/[::]:7447") -> Path:
    """Write a router's configuration: it applies the same list to its own neighbours. Returns the file."""
    tls = {
        "enable_mtls": True, "root_ca_certificate": f"{AUTHORITY}.pem", "close_link_on_expiration": True,
        "listen_certificate": f"{ROUTER}.pem", "listen_private_key": f"{ROUTER}.key",
        "connect_certificate": f"{ROUTER}.pem", "connect_private_key": f"{ROUTER}.key",
    }  # fmt: skip
    guard = limits(names, run)
    unicast = {key.rpartition("/")[2]: guard.pop(key) for key in list(guard) if "/" in key}
    config = {
        "mode": "router",
        "listen": {"endpoints": [listen]},
        # It waits for the clock as long as it takes, then and whenever that is away.
        "connect": {"endpoints": [clock], "timeout_ms": -1, "exit_on_failure": False},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport": {"unicast": unicast, "link": {"tls": tls}, "shared_memory": {"enabled": False}},
        **guard,
    }
    path = folder / "router.json5"
    path.write_text(json.dumps(config, indent=2) + "\n")
    return path


def limits(names: AccessList, run: str) -> dict[str, Any]:
    """Zenoh's settings for the node that everybody connects to: who may do what, how much, and how often."""
    keys = KeyExpressions(run)
    questions = [keys.control, keys.history, keys.scenario, keys.leave("*")]
    return {
        "access_control": access_control(names, run),
        "low_pass_filter": [
            _size("actions", ["put", "delete"], [keys.actions], ACTION_BYTES),
            _size("questions", ["query"], questions, QUESTION_BYTES),
        ],
        "downsampling": [
            _rate("actions", ["put", "delete"], {keys.actions: ACTIONS_HZ}),
            _rate("questions", ["query"], {
                keys.join("*"): JOINS_HZ, keys.leave("*"): JOINS_HZ, keys.scenario: JOINS_HZ, keys.slot: LOOKS_HZ,
            }),
        ],
        "transport/unicast/max_sessions": names.sessions,
        "transport/unicast/max_links": 1,
    }  # fmt: skip


def access_control(names: AccessList, run: str) -> dict[str, Any]:
    """Zenoh's ``access_control`` for a run: by default nothing, and for each name what it needs."""
    keys = KeyExpressions(run)
    known = [(name, _agent(keys, name)) for name in names.agents]
    known += [(name, _spawner(keys, name)) for name in names.spawners]
    known += [(name, _operator(keys)) for name in names.operators]
    # Those between which all else passes: a router's link to the clock, and the clock's to a router.
    known += [(name, _all(keys)) for name in (CLOCK, ROUTER)]
    rules: list[Rule] = []
    policies = []
    for name, wanted in known:
        mine = [{"id": f"{name} {i}", "permission": "allow", **rule} for i, rule in enumerate(wanted)]
        rules += mine
        policies.append({"id": name, "rules": [rule["id"] for rule in mine], "subjects": [name]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "subjects": [{"id": name, "cert_common_names": [name]} for name, _ in known],
        "rules": rules,
        "policies": policies,
    }


def _public(keys: KeyExpressions) -> Iterator[Rule]:
    """What all may see: the settled slots, and whether the clock is there."""
    slot = (keys.slot, f"{keys.slot}/@adv/**")
    yield _in((*READ, "query", *SEE), *slot)
    yield _out(("put", "reply", "declare_queryable", "liveliness_token"), *slot)
    yield _in(SEE, keys.clock_alive)
    yield _out(("liveliness_token",), keys.clock_alive)


def _agent(keys: KeyExpressions, name: str) -> Iterator[Rule]:
    yield from _public(keys)
    yield _in(READ, keys.observation(name))
    yield _out(("put",), keys.observation(name))
    yield _in(("put",), keys.action(name))
    yield _out(READ, keys.actions)
    yield _in(("liveliness_token",), keys.alive(name))
    yield _in(SERVE, keys.policy(name))
    yield _out(("query",), keys.policy(name))
    yield from _asks(keys.join(name), keys.leave(name))
    yield _out(("declare_queryable",), keys.join("*"), keys.leave("*"))


def _operator(keys: KeyExpressions) -> Iterator[Rule]:
    yield from _public(keys)
    yield from _sees_everyone(keys)
    spawners = [keys.spawner("*", "spawn"), keys.spawner("*", "stop"), keys.spawner("*", "status")]
    yield from _asks(keys.control, keys.history, keys.scenario, keys.policy("*"), *spawners)


def _spawner(keys: KeyExpressions, name: str) -> Iterator[Rule]:
    yield from _public(keys)
    yield from _sees_everyone(keys)
    mine = [keys.spawner(name, "spawn"), keys.spawner(name, "stop"), keys.spawner(name, "status")]
    yield _in(SERVE, *mine)
    yield _out(("query",), *mine, keys.spawner("*", "status"))


def _sees_everyone(keys: KeyExpressions) -> Iterator[Rule]:
    yield _in(SEE, keys.anyone_alive)
    yield _out(("liveliness_token",), keys.anyone_alive)


def _all(keys: KeyExpressions) -> Iterator[Rule]:
    yield _in(EVERYTHING, f"{keys.base}/**")
    yield _out(EVERYTHING, f"{keys.base}/**")


def _asks(*keys: str) -> Iterator[Rule]:
    yield _in(("query",), *keys)
    yield _out(("reply", "declare_queryable"), *keys)


def _in(messages: Sequence[str], *keys: str) -> Rule:
    """What comes from that name."""
    return {"flows": ["ingress"], "messages": list(messages), "key_exprs": list(keys)}


def _out(messages: Sequence[str], *keys: str) -> Rule:
    """What is passed on to it."""
    return {"flows": ["egress"], "messages": list(messages), "key_exprs": list(keys)}


def _size(name: str, messages: list[str], keys: Iterable[str], limit: int) -> Rule:
    return {"id": name, "messages": messages, "flows": ["ingress"], "key_exprs": list(keys), "size_limit": limit}


def _rate(name: str, messages: list[str], hertz: dict[str, float]) -> Rule:
    rules = [{"key_expr": key, "freq": freq} for key, freq in hertz.items()]
    return {"id": name, "messages": messages, "flows": ["ingress"], "rules": rules}
