"""The spawner's loop: one thread takes every question, every change of presence and every dead child in turn."""

from __future__ import annotations

import os
import signal
import socket
import time
from collections import OrderedDict
from dataclasses import dataclass, field
from queue import Empty, SimpleQueue
from typing import Literal

import psutil

from zengrid import logs
from zengrid.bus.credentials import Credentials
from zengrid.bus.hub import Query
from zengrid.bus.spawner import SpawnerEvent
from zengrid.errors import PolicyError, SecurityError, WireError
from zengrid.processes import Event, ProcessSpec, Restarts, Supervisor
from zengrid.processes.start import spawn
from zengrid.wire.codec import decode, encode
from zengrid.wire.requests import RefusalReason
from zengrid.wire.spawner import ProcessState, ProcessStatus, SpawnerStatus, SpawnRequest, StopReply, StopRequest
from zengrid_spawner.settings import Settings

ANSWER_S = 10.0
"""A process that does not take part after this time is reported as it is. [s]"""
MEMORY_S = 5.0
"""How often memory is looked at. [s]"""
TYPICAL_MB = 80.0
"""Memory that one more prosumer is expected to need. [MiB]"""
KEYS = 10_000
"""Most keys of requests that are remembered."""

Inbox = SimpleQueue[SpawnerEvent | Literal["child", "end"]]


@dataclass(slots=True)
class Child:
    """A process, and who waits to hear of it."""

    request: SpawnRequest
    starts: int = 0
    stopping: bool = False
    given_up: bool = False
    asked: list[Query] = field(default_factory=list)
    """Questions to answer once it takes part."""
    asked_to_stop: list[Query] = field(default_factory=list)
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

    # ---------------------------------------------------------------- lifecycle

    def serve(self) -> None:
        """Answer until a signal asks to stop."""
        for number, item in ((signal.SIGCHLD, "child"), (signal.SIGTERM, "end"), (signal.SIGINT, "end")):
            signal.signal(number, lambda *_, item=item: self._inbox.put(item))
        with self._supervisor:
            while self._take(self._idle_s()):
                pass
            self._end()

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
        for name in self._supervisor.alive():
            self._supervisor.stop(name)
        while self._supervisor.alive():
            self._take(self._supervisor.poll())

    # ---------------------------------------------------------------- questions

    def _reply(self, event: SpawnerEvent, query: Query) -> None:
        try:
            if event.kind == "spawn":
                self._spawn(decode(SpawnRequest, query.payload), query)
            elif event.kind == "stop":
                self._stop(decode(StopRequest, query.payload), query)
            else:
                query.reply(encode(self._status()))
        except (WireError, PolicyError) as error:
            query.refuse("invalid", str(error))

    def _spawn(self, request: SpawnRequest, query: Query) -> None:
        """Start a process; the answer follows when it takes part, or has failed."""
        name = request.home.id
        known = self._children.get(self._keys.get(request.key, "")) if request.key else None
        if known is not None:
            if known.request != request:
                query.refuse("taken", f"key = {request.key}: was used for another request; choose a new one")
                return
            known.asked.append(query)
            self._answer_if_ready(known)
            return
        refusal = self._refusal(name)
        if refusal is not None:
            query.refuse(*refusal)
            return
        spec = self._spec(request)
        if request.key:
            self._keys[request.key] = name
            if len(self._keys) > KEYS:
                self._keys.popitem(last=False)
        child = self._children[name] = Child(request, asked=[query], answer_at=time.monotonic() + ANSWER_S)
        self._supervisor.start(spec)
        logs.say(f"{name}: started for a request ({request.policy}, {child.request.home.pv_kw:g} kW PV)", agent=name)

    def _refusal(self, name: str) -> tuple[RefusalReason, str] | None:
        """Why a process of this name cannot be started."""
        it = self.settings
        alive = len(self._supervisor.alive())
        if name in self._children and not self._children[name].given_up:
            return "taken", f"id = {name}: runs here already, or is just ending"
        if name in self._present:
            return "taken", f"id = {name}: another process plays it; choose another id"
        if it.certs is not None:
            try:
                Credentials(it.certs, name)
            except SecurityError as error:
                return "invalid", f"id = {name}: {error}"
        if alive >= it.limit:
            return "full", f"processes = {alive}: spawner {it.name} runs {it.limit} at most"
        memory_mb = self._memory_mb()
        if memory_mb + TYPICAL_MB > it.memory_mb:
            return (
                "full",
                f"memory = {memory_mb:.0f} MiB: spawner {it.name} lets its processes have {it.memory_mb:.0f} MiB",
            )
        return None

    def _stop(self, request: StopRequest, query: Query) -> None:
        """End a process; the answer follows when it has gone."""
        child = self._children.get(request.id)
        if child is None:
            names = ", ".join(list(self._children)[:10]) or "none"
            query.refuse(
                "unknown", f"id = {request.id}: not a process of spawner {self.settings.name}, which runs {names}"
            )
            return
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
                query.refuse("invalid", self._why(child))
            else:
                query.reply(encode(self._process(child)))

    def _why(self, child: Child) -> str:
        """What a process that was given up has said."""
        name = child.request.home.id
        words = self._supervisor.last_words(name)
        return (
            words[-1].removeprefix("zengrid prosumer: ") if words else f"id = {name}: its process ended without a word"
        )

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
            restarts=Restarts(hopeless_s=ANSWER_S),
        )

    def _tell(self, event: Event) -> None:
        """What the supervisor has to say of a process."""
        logs.say(event.text, "info" if event.kind in ("started", "ended") else "warning", agent=event.name)
        child = self._children.get(event.name)
        if child is None:
            return
        if event.kind == "started":
            child.starts += 1
        elif event.kind == "ended":
            self._forget(event.name)
        elif event.kind in ("gave_up", "hopeless"):
            child.given_up = True
            self._answer(child)
            if event.kind == "hopeless":
                # It never took part: there is nothing to show of it.
                self._forget(event.name)

    def _forget(self, name: str) -> None:
        child = self._children.pop(name)
        for query in child.asked:
            query.refuse("unavailable", f"id = {name}: its process has ended")
        for query in child.asked_to_stop:
            query.reply(encode(StopReply(id=name)))

    def _kill_the_fat(self) -> None:
        """A process that takes too much memory is killed; the supervisor starts it again, or gives it up."""
        for name in self._children:
            memory_mb, most_mb = self._memory_of(name), self.settings.process_memory_mb
            pid = self._supervisor.pid(name)
            if memory_mb > most_mb and pid is not None:
                text = f"{name}: takes {memory_mb:.0f} MiB of memory, and may have {most_mb:.0f}: killing it"
                logs.say(text, "warning", agent=name)
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
            said=tuple(self._supervisor.last_words(name)),
        )

    def _state(self, child: Child, pid: int | None) -> ProcessState:
        if child.given_up:
            return "given_up"
        if child.stopping:
            return "stopping"
        if pid is None:
            return "restarting"
        return "running" if child.request.home.id in self._present else "starting"
