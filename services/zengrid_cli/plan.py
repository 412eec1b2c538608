"""Which processes make up a market on this machine, and how each is started."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from zengrid.processes import ProcessSpec, Restarts

if TYPE_CHECKING:
    from zengrid.scenario import Scenario

CLOCK, GRID, GATEWAY, SPAWNER, TABLE = "clock", "grid", "gateway", "spawner", "table"
"""Names of processes. A home may be called like one of them: prosumers have a prefix of their own."""

HOPELESS_S = 10.0
"""An error so soon after a first start is the user's to mend: a wrong path, an unknown policy, a journal in use. [s]"""
BINARY_HOMES = 64
"""Fleets from this size on use the compact encoding; smaller ones are quicker in JSON."""


def prosumer_name(agent: str) -> str:
    """The name of a prosumer's process."""
    return f"prosumer {agent}"


class Plan:
    """The processes of ``zengrid up``.

    Parameters
    ----------
    options:
        The command line, see ``zengrid_cli.options.up_parser``.
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
        """The clock; started again, it goes on where its journal ends."""
        it = self.options
        words = [it.scenario, "--listen", self.endpoint, "--run", it.run, "--journal", it.journal, *self._certs]
        words += ["--deadline", str(it.deadline), "--speed", f"{it.speed!r}x" if it.speed else "max"]
        words += ["--durability", it.durability, "--soc-reset", it.soc_reset]
        for option in ("data", "seed", "days", "keep_days", "journal_wait"):
            value = getattr(it, option)
            if value is not None:
                words += [f"--{option.replace('_', '-')}", str(value)]
        words += [f"--{flag}" for flag in ("paused", "insecure", "resume") if getattr(it, flag)]
        again = () if it.resume else ("--resume",)
        return self._spec(CLOCK, "zengrid_clock", words, again=again)

    def agents(self, scenario: Scenario) -> list[ProcessSpec]:
        """The grid agent and one process per prosumer agent, be it a home or a fleet."""
        it = self.options
        learn = self._learning()
        grid = _policy(it.grid_policy)
        specs = [self._spec(GRID, "zengrid_agent", ["grid", *self._bus, *grid, *learn])]
        policy = (*_policy(it.policy), *learn)
        for agent in scenario.agents:
            words = ["prosumer", "--id", agent.id, *self._bus, *policy]
            if len(agent.homes) >= BINARY_HOMES:
                words += ["--encoding", "binary"]
            specs.append(self._spec(prosumer_name(agent.id), "zengrid_agent", words))
        return specs

    def _learning(self) -> list[str]:
        """What agents are told of learning, where they shall."""
        it = self.options
        if not it.learn:
            return []
        learned = it.learned or self.folder / "learned"
        return [
            "--learn", "--learned", str(learned), "--explore", str(it.explore), "--learn-seed", str(it.learn_seed)
        ]  # fmt: skip

    def gateway(self, port: int) -> ProcessSpec:
        """The web page; it waits for the market, whose start it would only slow down."""
        words = ["zengrid_gateway", *self._bus, "--port", str(port)]
        return self._spec(
            GATEWAY, "zengrid_cli.after_first_slot", [*words, "--journal", self.options.journal], restarts=Restarts()
        )

    def spawner(self) -> ProcessSpec:
        """Starts the homes that are added on the web page, as processes of its own."""
        words = ["zengrid_spawner", *self._bus, "--logs", str(self.folder / "spawner")]
        return self._spec(SPAWNER, "zengrid_cli.after_first_slot", words, restarts=Restarts())

    def table(self, where: str, *, live: bool) -> ProcessSpec:
        """What is shown while the market runs, in a process of its own: it opens a session, the supervisor must not."""
        words = [*self._bus, "--events", str(self.events), "--where", where]
        if not live:
            words.append("--plain")
        restarts = Restarts(limit=3)
        return ProcessSpec(TABLE, "zengrid_cli.top", tuple(words), title="zengrid top", restarts=restarts)

    def _spec(
        self,
        name: str,
        module: str,
        words: Iterable[str],
        *,
        again: tuple[str, ...] = (),
        restarts: Restarts | None = None,
    ) -> ProcessSpec:
        return ProcessSpec(
            name,
            module,
            tuple(words),
            title=f"zengrid {name}",
            again=again,
            log=self.folder / f"{name.replace(' ', '-')}.log",
            restarts=restarts or Restarts(hopeless_s=HOPELESS_S),
        )


def _policy(spec: str | None) -> tuple[str, ...]:
    return () if spec is None else ("--policy", spec)
