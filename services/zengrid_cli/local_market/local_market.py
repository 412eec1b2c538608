"""A whole market on this machine: started, supervised, shown and ended cleanly."""

from __future__ import annotations

import argparse
import gc
import sys
import time

# Imported before any process is forked, for the clock and the agents, which then share its memory.
import safetensors  # noqa: F401

import zengrid.bus.agent_link
import zengrid.policy.registry  # noqa: F401
from zengrid import logs
from zengrid.bus.credentials import CLOCK as CLOCK_CERTIFICATE
from zengrid.bus.credentials import Credentials, secured
from zengrid.errors import EXIT_FAILED, EXIT_INTERRUPTED
from zengrid.policy import trained
from zengrid.processes import ProcessEvent, Signals, Supervisor, describe
from zengrid.processes.process_log import append_line, make_log_folder
from zengrid.scenario import Scenario, load
from zengrid.wire import queries, slots
from zengrid_cli.command_table import preload_agents
from zengrid_cli.local_market.free_endpoints import choose_endpoint, choose_http_port
from zengrid_cli.local_market.process_plan import CLOCK, GATEWAY, SPAWNER, TABLE, ProcessPlan

SHOW_AFTER_S = 0.3
"""When the table and the web page are started: until then the processor is for the first slot. [s]"""
LEAVE_S = 3.0
"""How long agents may take to end once the market is over. [s]"""
MESSAGES = (
    queries.JoinRequest, queries.JoinReply, slots.GridObservation, slots.GridAction, slots.FleetObservation,
    slots.FleetAction,
)  # fmt: skip
"""Messages of the agents."""


class LocalMarket:
    """A market on this machine.

    This process only supervises: it has no threads and opens no Zenoh session, since neither survives a fork, and
    agents are started by forks, at the beginning and whenever one of them has failed.

    Parameters
    ----------
    options:
        The arguments of ``zengrid up``.
    http_port:
        Port of the web page unless the options name one.
    """

    def __init__(self, options: argparse.Namespace, http_port: int) -> None:
        self.options = options
        self.plan = ProcessPlan(options, self._endpoint())
        self.port = None if options.no_http else choose_http_port(options.http, http_port)
        self.live = sys.stdout.isatty() and not (options.plain or options.quiet)
        self.supervisor = Supervisor(self._on_process_event)
        self.signals = Signals()
        self.failure: str | None = None
        """Why the market ended early."""

    def run(self) -> int:
        """Run the market until it is over; returns the exit code."""
        with self.signals, self.supervisor:
            self._start()
            return self._watch()

    def _endpoint(self) -> str:
        """Where the clock listens.

        Raises
        ------
        BusError
            If another process listens there.
        SecurityError
            If the clock's certificate is missing.
        """
        endpoint, certs = choose_endpoint(self.options.listen), self.options.certs
        if certs is None:
            return endpoint
        return secured(endpoint, Credentials(certs, CLOCK_CERTIFICATE))

    # ---------------------------------------------------------------- start and end

    def _start(self) -> None:
        """Load what all processes need, then fork them: the clock first, since it takes longest."""
        for message in MESSAGES:
            message.model_rebuild()
        it = self.options
        scenario = load(it.scenario, data=it.data, seed=it.seed)
        make_log_folder(self.plan.folder)
        self.plan.events.unlink(missing_ok=True)
        if it.learn:
            from zengrid.learn.require_torch import load_learning_agents

            # It takes seconds, which a running clock would count as a delay of its agents.
            load_learning_agents()
        # Without this the first garbage collection in each process would copy all the memory they share.
        gc.freeze()
        self.supervisor.start(self.plan.clock())
        preload_agents()
        gc.freeze()
        for spec in self.plan.agents(scenario):
            self.supervisor.start(spec)
        self._report_unfit_policies(scenario)

    def _report_unfit_policies(self, scenario: Scenario) -> None:
        """Report which of the shipped policies do not fit this market, and what its agents use instead."""
        from zengrid.env.facts import market_facts  # loaded while the market starts

        it = self.options
        if not it.learn and it.grid_policy in (None, "trained"):
            grid = trained.for_grid(market_facts(scenario))
            if grid.file is None:
                self._report(f"grid uses {grid.why}")
        if not it.learn and it.policy in (None, "trained"):
            homes = trained.for_prosumer(market_facts(scenario, scenario.home_ids))
            if homes.file is None:
                self._report(f"prosumers use {homes.why}")

    def _report(self, text: str) -> None:
        """Write a line to the events, and to the terminal unless a table shows the events."""
        self._write_event(text)
        if not self.live:
            logs.print_message(text)

    def _show(self) -> None:
        """Start the web page and the table."""
        if self.port is not None:
            self.supervisor.start(self.plan.gateway(self.port))
            self.supervisor.start(self.plan.spawner())
        if self.options.quiet:
            return
        page = "" if self.port is None else f"http://127.0.0.1:{self.port}   "
        where = f"{page}{self.plan.endpoint}"
        if not self.live:
            logs.print_message(f"{self.options.scenario} at {where}")
        self.supervisor.start(self.plan.table(where, live=self.live))

    def _watch(self) -> int:
        """Supervise all processes until the market is over; return the exit code."""
        asked = self.supervisor.supervise(self.signals, [CLOCK], within_s=SHOW_AFTER_S)
        if asked is None and self.failure is None and self.supervisor.alive([CLOCK]):
            self._show()
            asked = self.supervisor.supervise(self.signals, [CLOCK])
        if asked is not None:
            self.supervisor.stop_restarting()
            # The clock settles the current slot, and notifies all agents that the market is over.
            self.supervisor.stop(CLOCK, within_s=2.0 * self.options.deadline + LEAVE_S)
            if self.supervisor.supervise(self.signals, [CLOCK]) is not None:
                self.failure = "ended at once, after a second signal"
                return EXIT_INTERRUPTED
        code = self.supervisor.code(CLOCK)
        if code != 0 and self.failure is None:
            self.failure = f"clock: {describe(code or 0)}"
        self._end_agents(notified=self.failure is None)
        return 0 if self.failure is None else EXIT_FAILED

    def _end_agents(self, *, notified: bool) -> None:
        """Wait for agents that the clock has notified of the end; stop all others."""
        self.supervisor.stop_restarting()
        for name in self.supervisor.alive((TABLE, GATEWAY, SPAWNER)):
            self.supervisor.stop(name, within_s=LEAVE_S)
        if notified and self.supervisor.supervise(self.signals, within_s=LEAVE_S) is not None:
            return
        for name in self.supervisor.alive():
            self.supervisor.stop(name)
        self.supervisor.supervise(self.signals)

    # ---------------------------------------------------------------- events

    def _write_event(self, text: str) -> None:
        append_line(self.plan.events, f"{time.strftime('%H:%M:%S')} {logs.printable(text)}")

    def _on_process_event(self, event: ProcessEvent) -> None:
        """Record an event of a process, end the market if it must end, and print the event if no table does."""
        failed = event.kind in ("failed", "gave_up", "unrecoverable")
        if event.kind == "ended":
            failed = (self.supervisor.code(event.name) or 0) > 0
        lines = self.supervisor.last_log_lines(event.name) if failed else []
        text = f"{event.text} ({lines[-1]})" if lines else event.text
        if event.kind == "started" and "again" not in event.text:
            return
        self._write_event(text)
        if event.kind == "unrecoverable":
            # No slot has been settled: end with the error instead of running a market without this process.
            self.failure = self.failure or "\n  ".join(lines[-1:] if len(lines) == 1 else [event.text, *lines])
            self.supervisor.stop(CLOCK)
        elif event.kind == "gave_up" and event.name == CLOCK:
            self.failure = "\n  ".join([event.text, *lines])
        elif failed and self.failure is None and not (self.live and self.supervisor.alive([TABLE])):
            logs.print_message(text, "warning")
