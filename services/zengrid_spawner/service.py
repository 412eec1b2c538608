"""The spawner's loop: one thread takes every question, every change of presence and every dead child in turn."""

from __future__ import annotations

import os
import signal
import socket
import time
from collections import Counter, OrderedDict
from dataclasses import dataclass, field
from queue import Empty, SimpleQueue
from typing import Literal

import psutil

from zengrid import logs
from zengrid.bus.credentials import Credentials
from zengrid.bus.pending_query import PendingQuery
from zengrid.bus.spawner_link import SpawnerEvent
from zengrid.errors import SecurityError, ZengridError
from zengrid.processes import ProcessEvent, ProcessSpec, Restarts, Supervisor
from zengrid.processes.start import spawn
from zengrid.wire.codec import decode, encode
from zengrid.wire.queries import RefusalReason
from zengrid.wire.spawner_queries import (
    ProcessState,
    ProcessStatus,
    SpawnerStatus,
    SpawnRequest,
    StopReply,
    StopRequest,
)
from zengrid_spawner.settings import Settings

ANSWER_S = 10.0
"""A process that does not take part after this time is reported as it is. [s]"""
MEMORY_S = 5.0
"""How often memory is looked at. [s]"""
TYPICAL_MB = 80.0
"""Memory that one more prosumer is expected to need. [MiB]"""
TROUBLED_S = 1.0
"""Wait until processes are looked after again, where that has failed. [s]"""
KEYS = 10_000
"""Most keys of requests that are remembered."""

Inbox = SimpleQueue[SpawnerEvent | Literal["child", "end"]]


class RequestRefused(Exception):  # noqa: N818 - an answer, not an error
    """Why a request is not granted."""

    def __init__(self, reason: RefusalReason, message: str) -> None:
        super().__init__(message)
        self.reason: RefusalReason = reason


@dataclass(slots=True)
class Child:
    """A process, and who waits to hear of it."""

    request: SpawnRequest
    starts: int = 0
    stopping: bool = False
    given_up: bool = False
    trouble: str = ""
    """What happened to it last, where that was no good."""
    asked: list[PendingQuery] = field(default_factory=list)
    """Questions to answer once it takes part."""
    asked_to_stop: list[PendingQuery] = field(default_factory=list)
    answer_at: float = 0.0


class Spawner:
    """Starts, watches and ends prosumer processes until a signal asks to stop; then it ends them all."""

    def __init__(self, settings: Settings, inbox: Inbox) -> None:
        self.settings = settings
        self._inbox = inbox
        self._children: dict[str, Child] = {}
        self._keys: OrderedDict[str, str] = OrderedDict()
        """Home by the key of the request that brought it."""
        self._present: set[str] = set()
        self._supervisor = Supervisor(self._tell, start=spawn)
        self._memory_due = 0.0
        self._ending = False
        self._refused: Counter[str] = Counter()
        """Requests refused, by cause such as ``spawn_invalid``."""

    # ---------------------------------------------------------------- lifecycle

    def serve(self) -> None:
        """Answer until a signal asks to stop."""
        for number, item in ((signal.SIGCHLD, "child"), (signal.SIGTERM, "end"), (signal.SIGINT, "end")):
            signal.signal(number, lambda *_, item=item: self._inbox.put(item))
        with self._supervisor:
            while self._go_on():
                pass
            self._end()

    def _go_on(self) -> bool:
        """Look after the processes and handle one event; False when asked to end.

        Whatever goes wrong with one process or event: all others go on.
        """
        idle_s = TROUBLED_S
        try:
            idle_s = self._idle_s()
        except Exception as error:  # noqa: BLE001
            logs.print_unexpected("while it looked after its processes", error)
        try:
            return self._take(idle_s)
        except Exception as error:  # noqa: BLE001
            logs.print_unexpected("while it handled an event", error)
            return True

    def _idle_s(self) -> float:
        """Look after the processes; returns how long there is nothing to do. [s]"""
        due_s = self._supervisor.poll()
        now = time.monotonic()
        for child in self._children.values():
            if child.asked and child.answer_at <= now:
                self._answer(child)
        if now >= self._memory_due:
            self._kill_the_fat()
            self._memory_due = now + MEMORY_S
        due = [now + due_s, self._memory_due, *(child.answer_at for child in self._children.values() if child.asked)]
        return max(min(due) - now, 0.0)

    def _take(self, timeout_s: float) -> bool:
        """Handle one event, if one comes within the time; False when asked to end."""
        try:
            event = self._inbox.get(timeout=timeout_s)
        except Empty:
            return True
        if isinstance(event, str):
            return event != "end"
        if event.query is not None:
            self._reply(event, event.query)
        elif event.kind == "alive":
            self._present.add(event.agent)
            child = self._children.get(event.agent)
            if child is not None:
                self._answer(child)
        else:
            self._present.discard(event.agent)
        return True

    def _end(self) -> None:
        """Let all homes leave the market, and end."""
        self._ending = True
        for name in self._supervisor.alive():
            self._supervisor.stop(name)
        while self._supervisor.alive():
            self._go_on()

    # ---------------------------------------------------------------- questions

    def _reply(self, event: SpawnerEvent, query: PendingQuery) -> None:
        """Do what is asked for, or say why not: a question can be anything, and ends nothing but itself."""
        try:
            if event.kind == "spawn":
                self._spawn(decode(SpawnRequest, query.payload), query)
            elif event.kind == "stop":
                self._stop(decode(StopRequest, query.payload), query)
            else:
                query.reply(encode(self._status()))
        except RequestRefused as error:
            self._refuse(query, event.kind, error.reason, str(error))
        except ZengridError as error:
            self._refuse(query, event.kind, "invalid", str(error))
        except Exception as error:  # noqa: BLE001
            logs.print_unexpected(f"in a request ({event.kind})", error)
            self._refuse(query, event.kind, "unavailable", f"{type(error).__name__}: {error}")

    def _refuse(self, query: PendingQuery, asked: str, reason: RefusalReason, message: str) -> None:
        self._refused[f"{asked}_{reason}"] += 1
        logs.log_event("info", f"{asked} refused", reason=reason, why=message)
        query.refuse(reason, logs.printable(message))

    def _spawn(self, request: SpawnRequest, query: PendingQuery) -> None:
        """Start a process; the answer follows when it takes part, or has failed."""
        name = request.home.id
        known = self._children.get(self._keys.get(request.key, "")) if request.key else None
        if known is not None:
            if known.request != request:
                raise RequestRefused("taken", f"key = {request.key}: was used for another request; choose a new one")
            known.asked.append(query)
            self._answer_if_ready(known)
            return
        spec = self._spec(request)
        self._check_room(name)
        child = self._children[name] = Child(request, asked=[query], answer_at=time.monotonic() + ANSWER_S)
        try:
            self._supervisor.start(spec)
        except BaseException:
            self._children.pop(name, None)
            raise
        if child.starts:
            logs.print_message(
                f"{name}: started for a request ({request.policy}, {request.home.pv_kw:g} kW PV)", agent=name
            )
        if request.key and name in self._children:
            self._keys[request.key] = name
            if len(self._keys) > KEYS:
                self._keys.popitem(last=False)

    def _check_room(self, name: str) -> None:
        """Refuse where no process of this name can be started."""
        it = self.settings
        alive = len(self._supervisor.alive())
        if self._ending:
            raise RequestRefused("ended", f"spawner {it.name} is ending")
        if name in self._children and not self._children[name].given_up:
            raise RequestRefused("taken", f"id = {name}: runs here already, or is just ending")
        if name in self._present:
            raise RequestRefused("taken", f"id = {name}: another process plays it; choose another id")
        if it.certs is not None:
            try:
                Credentials(it.certs, name)
            except SecurityError as error:
                raise RequestRefused("invalid", f"id = {name}: {error}") from None
        if alive >= it.limit:
            raise RequestRefused("full", f"processes = {alive}: spawner {it.name} runs {it.limit} at most")
        memory_mb = self._memory_mb()
        if memory_mb + TYPICAL_MB > it.memory_mb:
            raise RequestRefused(
                "full",
                f"memory = {memory_mb:.0f} MiB: spawner {it.name} lets its processes have {it.memory_mb:.0f} MiB",
            )

    def _stop(self, request: StopRequest, query: PendingQuery) -> None:
        """End a process; the answer follows when it has gone."""
        child = self._children.get(request.id)
        if child is None:
            names = ", ".join(list(self._children)[:10]) or "none"
            where = f"spawner {self.settings.name}, which runs {names}"
            raise RequestRefused("unknown", f"id = {request.id}: not a process of {where}")
        child.stopping = True
        child.asked_to_stop.append(query)
        self._supervisor.stop(request.id)
        if not self._supervisor.alive([request.id]):
            self._forget(request.id)

    def _answer_if_ready(self, child: Child) -> None:
        if child.request.home.id in self._present or child.given_up:
            self._answer(child)

    def _answer(self, child: Child) -> None:
        """Tell those who asked for a process how it stands."""
        asked, child.asked = child.asked, []
        for query in asked:
            if child.given_up:
                self._refuse(query, "spawn", "invalid" if child.starts else "unavailable", self._why(child))
            else:
                query.reply(encode(self._process(child)))

    def _why(self, child: Child) -> str:
        """What a process that was given up has said; where it said nothing, what happened to it."""
        words = self._supervisor.last_log_lines(child.request.home.id)
        return words[-1].removeprefix("zengrid prosumer: ") if words else f"id = {child.trouble}"

    # ---------------------------------------------------------------- processes

    def _spec(self, request: SpawnRequest) -> ProcessSpec:
        it, home = self.settings, request.home
        certs = () if it.certs is None else ("--certs", str(it.certs))
        bus = ("--connect", it.endpoint, "--run", it.run, *certs)
        words = (
            "prosumer",
            "--id",
            home.id,
            "--home",
            home.model_dump_json(),
            "--policy",
            it.policy(request.policy),
            *bus,
        )
        return ProcessSpec(
            home.id,
            "zengrid_agent",
            words,
            title=f"zengrid prosumer {home.id}",
            log=it.logs / f"{home.id}.log",
            restarts=Restarts(unrecoverable_within_s=ANSWER_S),
        )

    def _tell(self, event: ProcessEvent) -> None:
        """What the supervisor has to say of a process."""
        logs.print_message(event.text, "info" if event.kind in ("started", "ended") else "warning", agent=event.name)
        child = self._children.get(event.name)
        if child is None:
            return
        if event.kind == "started":
            child.starts += 1
            return
        child.trouble = event.text
        if event.kind == "ended":
            self._forget(event.name)
        elif event.kind in ("gave_up", "unrecoverable"):
            child.given_up = True
            self._answer(child)
            if event.kind == "unrecoverable":
                # It never took part: there is nothing to show of it.
                self._forget(event.name)

    def _forget(self, name: str) -> None:
        child = self._children.pop(name)
        for query in child.asked:
            self._refuse(query, "spawn", "unavailable", f"id = {name}: its process has ended")
        for query in child.asked_to_stop:
            query.reply(encode(StopReply(id=name)))

    def _kill_the_fat(self) -> None:
        """A process that takes too much memory is killed; the supervisor starts it again, or gives it up."""
        for name in self._children:
            memory_mb, most_mb = self._memory_of(name), self.settings.process_memory_mb
            pid = self._supervisor.pid(name)
            if memory_mb > most_mb and pid is not None:
                text = f"{name}: takes {memory_mb:.0f} MiB of memory, and may have {most_mb:.0f}: killing it"
                logs.print_message(text, "warning", agent=name)
                os.kill(pid, signal.SIGKILL)

    def _memory_mb(self) -> float:
        return sum(self._memory_of(name) for name in self._children)

    def _memory_of(self, name: str) -> float:
        pid = self._supervisor.pid(name)
        try:
            return 0.0 if pid is None else float(psutil.Process(pid).memory_info().rss) / 2**20
        except psutil.Error:
            return 0.0

    def _status(self) -> SpawnerStatus:
        it = self.settings
        return SpawnerStatus(
            spawner=it.name,
            host=socket.gethostname(),
            limit=it.limit,
            memory_limit_mb=it.memory_mb,
            memory_mb=self._memory_mb(),
            policies=it.known_policies(),
            refused=dict(self._refused),
            processes=tuple(self._process(child) for child in self._children.values()),
        )

    def _process(self, child: Child) -> ProcessStatus:
        name = child.request.home.id
        pid = self._supervisor.pid(name)
        return ProcessStatus(
            id=name,
            policy=child.request.policy,
            pid=pid,
            state=self._state(child, pid),
            restarts=max(child.starts - 1, 0),
            memory_mb=self._memory_of(name),
            said=tuple(self._supervisor.last_log_lines(name)),
        )

    def _state(self, child: Child, pid: int | None) -> ProcessState:
        if child.given_up:
            return "given_up"
        if child.stopping:
            return "stopping"
        if pid is None:
            return "restarting"
        return "running" if child.request.home.id in self._present else "starting"
