"""Disables SO_LINGER on Zenoh's links, so that closing one link cannot block all others.

Zenoh 1.10 sets SO_LINGER to 10 s on every TCP socket. Closing the link of a process that has stopped reading then
blocks one of the few threads that serve all links, for up to 10 s (eclipse-zenoh/zenoh#2350, tokio-rs/tokio#7751): two
stopped viewers were enough to stop a market. Without the option, the kernel delivers the remaining data by itself.
"""

from __future__ import annotations

import socket
import struct
from pathlib import Path

import zenoh
from zenoh import handlers

_NO_LINGER = struct.pack("ii", 0, 0)


def disable_so_linger(session: zenoh.Session) -> zenoh.LinkEventsListener[None]:
    """Disable SO_LINGER for each link as soon as it is up; keep the returned listener as long as the session."""

    def changed(event: zenoh.LinkEvent) -> None:
        if event.kind == zenoh.SampleKind.PUT:
            _switch_off()

    return session.info.declare_link_events_listener(handlers.Callback(changed, indirect=False), history=True)


def _switch_off() -> None:
    # No descriptor may be copied and closed again: closing a copy gives up all locks of this process on the file behind
    # it, the journal's among them.
    for entry in list(Path("/dev/fd").iterdir()):
        try:
            link = socket.socket(fileno=int(entry.name))
        except OSError:
            continue  # no socket, or closed by now
        try:
            if link.family in (socket.AF_INET, socket.AF_INET6) and link.type == socket.SOCK_STREAM:
                link.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _NO_LINGER)
        except OSError:
            pass
        finally:
            link.detach()
