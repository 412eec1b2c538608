"""Questions to a spawner: start and stop prosumer processes on its machine, and tell which run there."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from zengrid.scenario.home_spec import HomeSpec, Printable
from zengrid.wire.base import AgentId, Message

ProcessState = Literal["starting", "running", "restarting", "stopping", "given_up"]


class SpawnRequest(Message):
    """Start a process that brings a home."""

    home: HomeSpec = Field(description="The home; its id is the agent's, too.")
    policy: Printable = Field(
        default="trained", max_length=200, description="Rule, or policy file known to the spawner."
    )
    key: Printable = Field(
        default="",
        max_length=200,
        description="Chosen by whoever asks: the same key again starts nothing a second time.",
    )


class ProcessStatus(Message):
    """One prosumer process of a spawner."""

    id: AgentId
    policy: str
    pid: int | None = Field(description="Null while it waits to be started again, or was given up.")
    state: ProcessState
    restarts: int = Field(description="How often it was started again.")
    memory_mb: float = Field(description="Resident memory [MiB].")
    said: tuple[str, ...] = Field(description="Its last lines of output.")


class StopRequest(Message):
    """End a process of this spawner; its home leaves the market."""

    id: AgentId


class StopReply(Message):
    """It was asked to end."""

    id: AgentId


class SpawnerRequest(Message):
    """Tell how things stand."""


class SpawnerStatus(Message):
    """One spawner and all its processes."""

    spawner: AgentId = Field(description="Its name.")
    host: str = Field(description="Its machine.")
    limit: int = Field(description="Most processes.")
    memory_limit_mb: float = Field(description="Most memory of all processes together [MiB].")
    memory_mb: float = Field(description="Memory of all processes together [MiB].")
    policies: tuple[str, ...] = Field(description="What its prosumers can play.")
    refused: dict[str, int] = Field(description="Refused requests by cause.")
    processes: tuple[ProcessStatus, ...]
