"""Every key expression of the protocol; no other module builds one."""

from __future__ import annotations

from typing import Literal

ROOT = "zengrid/@v1"
"""The version chunk starts with ``@``: ``zengrid/**`` does not match it, ``zengrid/@v1/**`` does."""

DEFAULT_RUN = "main"


class KeyExpressions:
    """The key expressions of one run."""

    def __init__(self, run: str = DEFAULT_RUN) -> None:
        self.run = run
        self.base = base = f"{ROOT}/{run}"
        self.slot = f"{base}/clock/slot"
        self.clock_alive = f"{base}/clock/alive"
        self.control = f"{base}/clock/control"
        self.history = f"{base}/clock/history"
        self.scenario = f"{base}/clock/scenario"
        self.actions = f"{base}/agent/*/action"
        self.alive_all = f"{base}/agent/*/alive"
        self.anyone_alive = f"{base}/**/alive"
        self._agent = f"{base}/agent"

    def join(self, agent: str) -> str:
        """Where an agent's process asks to join; the clock serves it with ``*``.

        The key contains the agent because an access list can check nothing else about the sender of a query.
        """
        return f"{self.base}/clock/join/{agent}"

    def leave(self, agent: str) -> str:
        """Where an agent asks to leave."""
        return f"{self.base}/clock/leave/{agent}"

    def observation(self, agent: str) -> str:
        """Where the clock sends an agent's observations."""
        return f"{self._agent}/{agent}/observation"

    def action(self, agent: str) -> str:
        """Where an agent sends its actions."""
        return f"{self._agent}/{agent}/action"

    def alive(self, agent: str) -> str:
        """An agent's liveliness token."""
        return f"{self._agent}/{agent}/alive"

    def policy(self, agent: str) -> str:
        """Where an agent answers policy queries."""
        return f"{self._agent}/{agent}/policy"

    def spawner(self, name: str, what: Literal["spawn", "stop", "status"]) -> str:
        """Where a spawner answers queries; the name ``*`` reaches all spawners."""
        return f"{self.base}/spawner/{name}/{what}"


def agent_of(key: str) -> str:
    """The agent in a key such as ``.../agent/p1/action``."""
    return key.rsplit("/", 2)[1]


def asker_of(key: str) -> str:
    """The agent in a key such as ``.../clock/join/p1``."""
    return key.rpartition("/")[2]
