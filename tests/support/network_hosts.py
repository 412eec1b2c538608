"""Other machines, as network namespaces of this one, each at the end of a cable of its own; needs root and Linux."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import TracebackType
from typing import Self

CABLE = Path(__file__).with_name("network_cable.py")


def why_not() -> str | None:
    """Why there can be no such hosts here; None where there can."""
    if shutil.which("ip") is None:
        return "needs the command ip (Debian: iproute2)"
    if os.geteuid() != 0:
        return "needs root, to make network namespaces"
    if not Path("/dev/net/tun").exists():
        return "needs /dev/net/tun, for cables with latency and loss"
    probe = f"zgprobe{os.getpid()}"
    if subprocess.run(["ip", "netns", "add", probe], capture_output=True).returncode:
        return "cannot make network namespaces here"
    subprocess.run(["ip", "netns", "delete", probe], check=True)
    return None


class NetworkHosts:
    """A network of hosts around this one. Use it with ``with``; nothing is left of it at the end.

    Parameters
    ----------
    names:
        One namespace and one cable each, at most four.
    """

    def __init__(self, *names: str) -> None:
        self.names = names
        self._tag = f"zg{os.getpid() % 100_000}"
        self._subnet = f"198.18.{os.getpid() % 254}"  # set aside for tests of networks (RFC 2544)
        self.here = f"{self._subnet}.1"
        self._namespaces: list[str] = []

    def __enter__(self) -> Self:
        cables = [self._cable(name) for name in self.names]
        self._cables = subprocess.Popen(
            [sys.executable, str(CABLE), *cables], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        try:
            assert self._cables.stdout is not None
            assert self._cables.stdout.readline() == b"ready\n"
            self._lay()
        except BaseException:
            self._remove()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._remove()

    def _cable(self, name: str) -> str:
        return f"{self._tag}{self.names.index(name)}"

    def namespace(self, name: str) -> str:
        """Of a host."""
        return f"{self._tag}-{name}"

    def address(self, name: str) -> str:
        """Of a host, as the others reach it."""
        return f"{self._subnet}.{10 + self.names.index(name)}"

    def on(self, name: str, *command: str) -> tuple[str, ...]:
        """A command, to be run on a host."""
        return ("ip", "netns", "exec", self.namespace(name), *command)

    def quality(self, name: str, delay_s: float = 0.0, loss: float = 0.0) -> None:
        """How good a host's cable is, each way. [s], [1]"""
        assert self._cables.stdin is not None
        self._cables.stdin.write(f"{self._cable(name)} {delay_s} {loss}\n".encode())
        self._cables.stdin.flush()

    def cut(self, name: str) -> None:
        """Cut a host's cable: nobody is told, all frames are lost; ``quality`` mends it."""
        self.quality(name, loss=1.0)

    def _lay(self) -> None:
        bridge = f"{self._tag}br"
        _ip("link", "add", bridge, "type", "bridge")
        _ip("address", "add", f"{self.here}/24", "dev", bridge)
        _ip("link", "set", bridge, "up")
        for name in self.names:
            namespace, cable = self.namespace(name), self._cable(name)
            _ip("netns", "add", namespace)
            self._namespaces.append(namespace)
            _ip("link", "set", f"{cable}a", "master", bridge)
            _ip("link", "set", f"{cable}a", "up")
            _ip("link", "set", f"{cable}b", "netns", namespace)
            _ip("-n", namespace, "link", "set", "lo", "up")
            _ip("-n", namespace, "address", "add", f"{self.address(name)}/24", "dev", f"{cable}b")
            _ip("-n", namespace, "link", "set", f"{cable}b", "up")

    def _remove(self) -> None:
        self._cables.kill()
        self._cables.communicate()
        for namespace in self._namespaces:
            _ip("netns", "delete", namespace)
        subprocess.run(["ip", "link", "delete", f"{self._tag}br"], capture_output=True)


def _ip(*words: str) -> None:
    done = subprocess.run(["ip", *words], capture_output=True, text=True)
    assert done.returncode == 0, f"ip {' '.join(words)}: {done.stderr}"
