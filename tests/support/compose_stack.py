"""The stack of docker-compose.yml, brought up by a real engine under a name and port of its own."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Self

ROOT = Path(__file__).parents[2]
PATIENCE_S = 240.0
"""Containers start slowly on a machine that is busy. [s]"""


class ComposeStack:
    """A running stack. Use it with ``with``: nothing of it is left at the end."""

    def __init__(self, compose: Sequence[str], environment: dict[str, str]) -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = int(probe.getsockname()[1])
        self.compose = list(compose)
        self.environment = {
            **os.environ, **environment, "ZENGRID_HTTP_PORT": str(self.port),
            "COMPOSE_PROJECT_NAME": f"zengridtest{os.getpid()}",
        }  # fmt: skip

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.run("down", "--volumes", "--timeout", "20")

    def run(self, *words: str) -> str:
        """A Compose command; returns what it printed."""
        return self._call([*self.compose, *words])

    def docker(self, *words: str) -> str:
        """A Docker command; returns what it printed."""
        return self._call(["docker", *words])

    def _call(self, command: list[str]) -> str:
        done = subprocess.run(command, cwd=ROOT, env=self.environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{' '.join(command)}\n{done.stdout[-3000:]}\n{done.stderr[-3000:]}"
        return done.stdout

    def containers(self, service: str) -> list[str]:
        """Ids of a service's containers, in the order of their numbers."""
        return self.run("ps", "-q", service).split()

    def kill(self, container: str) -> None:
        """Kill what runs in a container, as a crash would; its restart policy sees to the rest."""
        pid = int(self.docker("inspect", "--format", "{{.State.Pid}}", container))
        os.kill(pid, 9)

    def get(self, path: str, timeout_s: float = 10.0) -> Any:
        """What the gateway answers."""
        with urllib.request.urlopen(f"http://127.0.0.1:{self.port}{path}", timeout=timeout_s) as answer:
            return json.load(answer)

    def wait(self, wanted: Callable[[], Any], missing: str) -> Any:
        """Wait until something comes true; while the gateway does not answer, it is not."""
        until = time.monotonic() + PATIENCE_S
        last: object = None
        while time.monotonic() < until:
            try:
                last = wanted()
            except (OSError, urllib.error.URLError, KeyError) as error:
                last = error
            else:
                if last:
                    return last
            time.sleep(0.5)
        logs = self.run("logs", "--tail", "15")
        raise AssertionError(f"{missing} did not come within {PATIENCE_S:g} s; last: {last!r}\n{logs}")

    def wait_for_agents(self, count: int) -> dict[str, str]:
        """Wait until so many homes are commanded by a process; returns their container of agents' names."""

        def all_there() -> dict[str, str] | None:
            homes = self.get("/v1/prosumers")["prosumers"]
            present = {home["id"]: home["presence"] for home in homes}
            return present if sorted(present.values()) == ["present"] * count else None

        found: dict[str, str] = self.wait(all_there, f"{count} homes, all of them played")
        return found

    def wait_for_slots(self, count: int) -> int:
        """Wait until so many more slots are settled; returns the last position."""
        begin = self.wait(lambda: self.get("/v1/price"), "a price")["position"]

        def further() -> int | None:
            position = int(self.get("/v1/price")["position"])
            return position if position >= begin + count else None

        found: int = self.wait(further, f"{count} slots after slot {begin}")
        return found
