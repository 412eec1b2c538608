"""Every key of the protocol; no string of a key stands anywhere else."""

from __future__ import annotations

from typing import Literal

ROOT = "zengrid/@v1"
"""The version chunk starts with ``@``: ``zengrid/**`` does not match it, ``zengrid/@v1/**`` does."""

DEFAULT_RUN = "main"


class Keys:
    """Keys of one run."""

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
        """Where the process of an agent asks to take part; ``*`` is where the clock answers all of them.

        The agent is part of the key because a question says nothing else of who asks that an access list could check.
        """
        return f"{self.base}/clock/join/{agent}"

    def leave(self, agent: str) -> str:
        """Where it asks to be taken out."""
        return f"{self.base}/clock/leave/{agent}"

    def observation(self, agent: str) -> str:
        """Where the clock tells an agent what it may see."""
        return f"{self._agent}/{agent}/observation"

    def action(self, agent: str) -> str:
        """Where an agent answers."""
        return f"{self._agent}/{agent}/action"

    def alive(self, agent: str) -> str:
        """An agent's liveliness token."""
        return f"{self._agent}/{agent}/alive"

    def policy(self, agent: str) -> str:
        """Where an agent answers what it would do."""
        return f"{self._agent}/{agent}/policy"

    def spawner(self, name: str, what: Literal["spawn", "stop", "status"]) -> str:
        """Where a spawner answers; the name ``*`` asks all of them."""
        return f"{self.base}/spawner/{name}/{what}"


def agent_of(key: str) -> str:
    """The agent in a key such as ``.../agent/p1/action``."""
    return key.rsplit("/", 2)[1]


def asker_of(key: str) -> str:
    """The agent in a key such as ``.../clock/join/p1``."""
    return key.rpartition("/")[2]
