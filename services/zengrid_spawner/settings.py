"""What a spawner is started with, and what it lets its prosumers play."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path

from zengrid.bus.addresses import DEFAULT_ENDPOINT
from zengrid.bus.keys import DEFAULT_RUN
from zengrid.bus.machine_name import machine_name
from zengrid.errors import PolicyError
from zengrid.policy.registry import PROSUMER_POLICIES, prosumer_policy_files


def default_name() -> str:
    """This machine's name."""
    return machine_name() or "spawner"


def default_logs() -> Path:
    """Where processes write unless told otherwise."""
    state = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return Path(state) / "zengrid" / "spawner"


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """One spawner."""

    name: str = field(default_factory=default_name)
    run: str = DEFAULT_RUN
    endpoint: str = DEFAULT_ENDPOINT
    certs: Path | None = None
    """Folder of certificates, of this spawner and of all it may start, where the market needs one."""
    limit: int
    """Most processes."""
    memory_mb: float
    """Most memory of all processes together. [MiB]"""
    process_memory_mb: float
    """A process that takes more is killed, and started again. [MiB]"""
    logs: Path = field(default_factory=default_logs)
    policies: Path | None = None
    """Folder of policy files that prosumers may play."""

    def known_policies(self) -> tuple[str, ...]:
        """What prosumers here can play: rules, and the files of the folder."""
        files = () if self.policies is None else sorted(path.name for path in self.policies.glob("*.safetensors"))
        return (*PROSUMER_POLICIES, *files)

    def policy(self, name: str) -> str:
        """What an agent is told to play.

        Raises
        ------
        PolicyError
            Neither a rule nor one of the folder's files, which are all that a request reaches; or what stands behind
            the name of a rule is wrong in every market.
        """
        known = self.known_policies()
        if self.policies is not None and name in known and name not in PROSUMER_POLICIES:
            return str(self.policies / name)
        if name.partition(":")[0] not in PROSUMER_POLICIES:
            raise PolicyError(f"policy = {name}: this spawner knows {', '.join(known)}")
        files = prosumer_policy_files(name)
        if files:
            raise PolicyError(
                f"policy = {name}: reads {files[0]}; permitted is what this spawner knows and zengrid has"
            )
        return name
