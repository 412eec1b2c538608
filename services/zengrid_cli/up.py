"""``zengrid up``: a whole market on this machine, started, supervised, shown and ended cleanly."""

from __future__ import annotations

import argparse
import gc
import shlex
import sys
import time
from collections.abc import Sequence
from importlib import import_module
from typing import TYPE_CHECKING

from zengrid import logs
from zengrid.errors import ZengridError
from zengrid.processes import Event, Signals, Supervisor, describe
from zengrid.processes.log import append, make_folder
from zengrid_cli.endpoint import choose_endpoint, choose_http_port
from zengrid_cli.options import HTTP_PORT, up_parser
from zengrid_cli.plan import CLOCK, GATEWAY, SPAWNER, TABLE, Plan

if TYPE_CHECKING:
    from zengrid.scenario import Scenario

SHARED = ("zengrid.bus.agent_link", "zengrid.policy.registry", "zengrid.policy.trained", "safetensors")
"""Loaded before anything is forked."""
OF_AGENTS = ("zengrid_agent.grid", "zengrid_agent.prosumer")
"""Loaded while the clock gets ready; by name, since services do not know each other."""

SHOW_AFTER_S = 0.3
"""When table and web page are started: at first the machine belongs to those who settle the first slot. [s]"""
LEAVE_S = 3.0
"""How long agents may take to leave by themselves once the market is over. [s]"""


class Local:
    """A market on this machine.

    This process only supervises: it has no threads and opens no Zenoh session, since neither survives the forks by
    which agents are started, at the beginning and whenever one of them has died.
    """

    def __init__(self, options: argparse.Namespace) -> None:
        self.options = options
        self.plan = Plan(options, self._endpoint())
        self.port = None if options.no_http else choose_http_port(options.http, HTTP_PORT)
        self.live = sys.stdout.isatty() and not (options.plain or options.quiet)
        self.supervisor = Supervisor(self._note)
        self.signals = Signals()
        self.trouble: str | None = None
        """Why the market ended before its time."""

    def run(self) -> int:
        """Run the market until it is over; returns the exit code."""
        with self.signals, self.supervisor:
            self._start()
            return self._watch()

    def _endpoint(self) -> str:
        """Where the clock listens; the first thing to fail where its certificate is missing."""
        endpoint, certs = choose_endpoint(self.options.listen), self.options.certs
        if certs is None:
            return endpoint
        from zengrid.bus.credentials import CLOCK, Credentials, secured

        return secured(endpoint, Credentials(certs, CLOCK))

    # ---------------------------------------------------------------- its life

    def _start(self) -> None:
        # What all need is loaded once and shared, then they are forked: the clock first, since it needs longest.
        scenario = self._load()
        make_folder(self.plan.folder)
        self.plan.events.unlink(missing_ok=True)
        if self.options.learn:
            # It takes seconds, which a clock that runs already would count as its agents' delay.
            import_module("zengrid_agent.learning").load_torch()
        # Without this the first collection in each process would copy all the memory they share.
        gc.freeze()
        self.supervisor.start(self.plan.clock())
        for module in OF_AGENTS:
            import_module(module)
        gc.freeze()
        for spec in self.plan.agents(scenario):
            self.supervisor.start(spec)
        self._tell_misfits(scenario)

    def _tell_misfits(self, scenario: Scenario) -> None:
        """Say which of the policies that come with zengrid do not fit this market, and what is played instead."""
        from zengrid.env.facts import market_facts
        from zengrid.policy import trained

        it = self.options
        if not it.learn and it.grid_policy in (None, "trained"):
            grid = trained.for_grid(market_facts(scenario))
            if grid.file is None:
                self._write(f"grid plays {grid.why}")
        if not it.learn and it.policy in (None, "trained"):
            homes = trained.for_prosumer(market_facts(scenario, scenario.home_ids))
            if homes.file is None:
                self._write(f"prosumers play {homes.why}")

    def _write(self, text: str) -> None:
        """A line among the events, and where no table shows these, on the terminal."""
        append(self.plan.events, f"{time.strftime('%H:%M:%S')} {logs.printable(text)}")
        if not self.live:
            logs.say(text)

    def _show(self) -> None:
        """Start what only watches."""
        if self.port is not None:
            self.supervisor.start(self.plan.gateway(self.port))
            self.supervisor.start(self.plan.spawner())
        if self.options.quiet:
            return
        page = "" if self.port is None else f"http://127.0.0.1:{self.port}   "
        where = f"{page}{self.plan.endpoint}"
        if not self.live:
            logs.say(f"{self.options.scenario} at {where}")
        self.supervisor.start(self.plan.table(where, live=self.live))

    def _load(self) -> Scenario:
        for module in SHARED:
            import_module(module)
        from zengrid.scenario import load
        from zengrid.wire import queries, slots

        for message in (
            queries.JoinRequest, queries.JoinReply, slots.GridObservation, slots.GridAction, slots.FleetObservation,
            slots.FleetAction,
        ):  # fmt: skip
            message.model_rebuild()
        return load(self.options.scenario, data=self.options.data, seed=self.options.seed)

    def _watch(self) -> int:
        """Look after everything until the market is over."""
        asked = self.supervisor.look_after(self.signals, [CLOCK], within_s=SHOW_AFTER_S)
        if asked is None and self.trouble is None and self.supervisor.alive([CLOCK]):
            self._show()
            asked = self.supervisor.look_after(self.signals, [CLOCK])
        if asked is not None:
            self.supervisor.release()
            # The clock settles the slot it is in, and tells everybody that the market is over.
            self.supervisor.stop(CLOCK, within_s=2.0 * self.options.deadline + LEAVE_S)
            if self.supervisor.look_after(self.signals, [CLOCK]) is not None:
                self.trouble = "ended at once, as asked for a second time"
                return 130
        code = self.supervisor.code(CLOCK)
        if code != 0 and self.trouble is None:
            self.trouble = f"clock: {describe(code or 0)}"
        self._dismiss(told=self.trouble is None)
        return 0 if self.trouble is None else 1

    def _dismiss(self, *, told: bool) -> None:
        """Agents that were told of the end leave by themselves; all others are asked to."""
        self.supervisor.release()
        for name in self.supervisor.alive((TABLE, GATEWAY, SPAWNER)):
            self.supervisor.stop(name, within_s=LEAVE_S)
        if told and self.supervisor.look_after(self.signals, within_s=LEAVE_S) is not None:
            return
        for name in self.supervisor.alive():
            self.supervisor.stop(name)
        self.supervisor.look_after(self.signals)

    # ---------------------------------------------------------------- what it says

    def _note(self, event: Event) -> None:
        """Write down what happens to processes, end the market where it must, and tell where no table does."""
        failed = event.kind in ("failed", "gave_up", "hopeless")
        if event.kind == "ended":
            failed = (self.supervisor.code(event.name) or 0) > 0
        words = self.supervisor.last_words(event.name) if failed else []
        text = f"{event.text} ({words[-1]})" if words else event.text
        if event.kind == "started" and "again" not in event.text:
            return
        append(self.plan.events, f"{time.strftime('%H:%M:%S')} {logs.printable(text)}")
        if event.kind == "hopeless":
            # Nothing runs that could be saved: say what is wrong instead of running a market without this process.
            self.trouble = self.trouble or "\n  ".join(words[-1:] if len(words) == 1 else [event.text, *words])
            self.supervisor.stop(CLOCK)
        elif event.kind == "gave_up" and event.name == CLOCK:
            self.trouble = "\n  ".join([event.text, *words])
        elif failed and self.trouble is None and not (self.live and self.supervisor.alive([TABLE])):
            logs.say(text, "warning")


def main(arguments: Sequence[str]) -> int:
    """Run a market; returns the exit code."""
    started = time.time() - _age_s()
    options = up_parser().parse_args(arguments)
    logs.export(options)
    logs.begin("up", options, run=options.run)
    try:
        local = Local(options)
        code = local.run()
    except ZengridError as error:
        logs.fail(error)
        return 1
    if local.live:
        # A table that was killed leaves the cursor hidden.
        sys.stdout.write("\x1b[?25h")
    if code != 130:
        from zengrid_cli.summary import print_summary

        print_summary(options, shlex.join(["zengrid", "up", *arguments]), since=started)
    if local.trouble is not None:
        logs.say(local.trouble, "error")
        logs.say(f"logs: {local.plan.folder}")
    return code


def _age_s() -> float:
    """How long ago this process was started: what Python took to load counts, too. [s]"""
    import os
    from pathlib import Path

    ticks = int(Path("/proc/self/stat").read_text().rpartition(")")[2].split()[19])
    return time.clock_gettime(time.CLOCK_BOOTTIME) - ticks / os.sysconf("SC_CLK_TCK")
