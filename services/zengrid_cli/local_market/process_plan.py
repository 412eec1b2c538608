"""Which processes make up a market on this machine, and how each is started."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from zengrid.processes import ProcessSpec, Restarts
from zengrid_cli import command_table

if TYPE_CHECKING:
    from zengrid.scenario import Scenario

CLOCK, GRID, GATEWAY, SPAWNER, TABLE = "clock", "grid", "gateway", "spawner", "table"
"""Names of processes. A home can have one of these names: the names of prosumers' processes have a prefix."""
TOP_MODULE = "zengrid_cli.commands.top_command"
AFTER_FIRST_SLOT_MODULE = "zengrid_cli.local_market.after_first_slot"

UNRECOVERABLE_WITHIN_S = 10.0
"""An error so soon after the first start is the user's to correct: a wrong path, an unknown policy. [s]"""
BINARY_HOMES = 64
"""Fleets of this size and larger use the binary encoding; smaller ones are faster in JSON."""


def prosumer_process_name(agent: str) -> str:
    """The name of a prosumer's process."""
    return f"prosumer {agent}"


class ProcessPlan:
    """The processes of ``zengrid up``.

    Parameters
    ----------
    options:
        The arguments of ``zengrid up``.
    endpoint:
        Where the clock listens.
    """

    def __init__(self, options: argparse.Namespace, endpoint: str) -> None:
        self.options = options
        self.endpoint = endpoint
        self.folder: Path = options.logs / options.run
        self.events = self.folder / "events.log"
        self._certs = () if options.certs is None else ("--certs", str(options.certs))
        self._bus = ("--connect", endpoint, "--run", options.run, *self._certs)

    def clock(self) -> ProcessSpec:
        """The clock; when it is restarted, it continues where its journal ends."""
        it = self.options
        arguments = [it.scenario, "--listen", self.endpoint, "--run", it.run, "--journal", it.journal, *self._certs]
        arguments += ["--speed", f"{it.speed!r}x" if it.speed else "max"]
        for option in ("data", "seed", "days", "deadline", "soc_reset", "keep_days", "journal_wait", "durability"):
            value = getattr(it, option)
            if value is not None:
                arguments += [f"--{option.replace('_', '-')}", str(value)]
        arguments += [f"--{flag}" for flag in ("paused", "insecure", "resume") if getattr(it, flag)]
        again = () if it.resume else ("--resume",)
        return self._spec(CLOCK, command_table.CLOCK, arguments, again=again)

    def agents(self, scenario: Scenario) -> list[ProcessSpec]:
        """The grid agent, and one process for each prosumer agent, which may have one home or a fleet."""
        it = self.options
        learning = self._learning()
        grid = ["grid", *self._bus, *_policy(it.grid_policy), *learning]
        specs = [self._spec(GRID, command_table.AGENT, grid)]
        for agent in scenario.agents:
            arguments = ["prosumer", "--id", agent.id, *self._bus, *_policy(it.policy), *learning]
            if len(agent.homes) >= BINARY_HOMES:
                arguments += ["--encoding", "binary"]
            specs.append(self._spec(prosumer_process_name(agent.id), command_table.AGENT, arguments))
        return specs

    def _learning(self) -> list[str]:
        """The agents' arguments about learning."""
        it = self.options
        if not it.learn:
            return []
        learned = it.learned or self.folder / "learned"
        return [
            "--learn", "--learned", str(learned), "--explore", str(it.explore), "--learn-seed", str(it.learn_seed)
        ]  # fmt: skip

    def gateway(self, port: int) -> ProcessSpec:
        """The web page; it waits for the first slot, since it would slow down the start of the market."""
        arguments = [*self._bus, "--port", str(port), "--journal", self.options.journal]
        return self._spec_after_first_slot(GATEWAY, command_table.GATEWAY, arguments)

    def spawner(self) -> ProcessSpec:
        """The spawner, which starts the homes that are added on the web page."""
        arguments = [*self._bus, "--logs", str(self.folder / "spawner")]
        return self._spec_after_first_slot(SPAWNER, command_table.SPAWNER, arguments)

    def table(self, where: str, *, live: bool) -> ProcessSpec:
        """The live view: a process of its own, since it opens a session, and the supervisor must not."""
        arguments = [*self._bus, "--events", str(self.events), "--where", where]
        if not live:
            arguments.append("--plain")
        restarts = Restarts(limit=3)
        return ProcessSpec(TABLE, TOP_MODULE, tuple(arguments), title="zengrid top", restarts=restarts)

    def _spec_after_first_slot(self, name: str, module: str, arguments: Iterable[str]) -> ProcessSpec:
        return self._spec(name, AFTER_FIRST_SLOT_MODULE, [module, *arguments], restarts=Restarts())

    def _spec(
        self,
        name: str,
        module: str,
        arguments: Iterable[str],
        *,
        again: tuple[str, ...] = (),
        restarts: Restarts | None = None,
    ) -> ProcessSpec:
        return ProcessSpec(
            name,
            module,
            tuple(arguments),
            title=f"zengrid {name}",
            again=again,
            log=self.folder / f"{name.replace(' ', '-')}.log",
            restarts=restarts or Restarts(unrecoverable_within_s=UNRECOVERABLE_WITHIN_S),
        )


def _policy(policy: str | None) -> tuple[str, ...]:
    return () if policy is None else ("--policy", policy)
