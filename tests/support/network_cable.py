"""Cables between network namespaces, with latency and loss, in a separate process: ``python network_cable.py NAME...``.

Every cable is a pair of TAP devices, ``NAMEa`` and ``NAMEb``, between which this process carries frames. It does what
``tc netem`` would, which needs a kernel module that many machines (containers, small virtual machines) do not have.
A line ``NAME DELAY_S LOSS`` on standard input changes a cable, one way each; a loss of 1 cuts it.
"""

from __future__ import annotations

import fcntl
import heapq
import os
import random
import select
import struct
import sys
import time

TUNSETIFF, IFF_TAP, IFF_NO_PI = 0x400454CA, 0x0002, 0x1000
FRAME = 65_536


def open_tap(name: str) -> int:
    """A new network device; what the kernel sends there can be read, what is written is received."""
    device = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(device, TUNSETIFF, struct.pack("16sH22x", name.encode(), IFF_TAP | IFF_NO_PI))
    return device


def main(names: list[str]) -> None:
    """Carry frames until standard input ends."""
    rng = random.Random(1)
    ends = {name: (open_tap(f"{name}a"), open_tap(f"{name}b")) for name in names}
    way = {this: (name, other) for name, (a, b) in ends.items() for this, other in ((a, b), (b, a))}
    quality = dict.fromkeys(names, (0.0, 0.0))
    underway: list[tuple[float, int, int, bytes]] = []
    count = 0
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    while True:
        wait_s = max(underway[0][0] - time.monotonic(), 0.0) if underway else None
        ready, _, _ = select.select([0, *way], [], [], wait_s)
        for device in ready:
            if device == 0:
                line = os.read(0, FRAME).decode().split()
                if not line:
                    return
                for name, *numbers in zip(line[::3], line[1::3], line[2::3], strict=True):
                    quality[name] = float(numbers[0]), float(numbers[1])
                continue
            name, other = way[device]
            delay_s, loss = quality[name]
            try:
                frame = os.read(device, FRAME)
            except OSError:
                continue  # the device is down, or has nothing after all
            if rng.random() >= loss:
                count += 1
                heapq.heappush(underway, (time.monotonic() + delay_s, count, other, frame))
        now = time.monotonic()
        while underway and underway[0][0] <= now:
            _, _, device, frame = heapq.heappop(underway)
            try:
                os.write(device, frame)
            except OSError:
                continue  # down: the frame is lost


if __name__ == "__main__":
    main(sys.argv[1:])
