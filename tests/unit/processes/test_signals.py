"""Signals are taken as they were sent, and nothing else is."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

WAITS = """
from zengrid.processes import Signals

with Signals() as signals:
    print("waits", flush=True)
    while (asked := signals.wait(0.05)) is None:
        pass
    print(int(asked), flush=True)
"""


def test_a_process_that_was_stopped_takes_no_signal_that_nobody_sent() -> None:
    with subprocess.Popen([sys.executable, "-c", WAITS], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "waits\n"
        for _ in range(5):
            process.send_signal(signal.SIGSTOP)
            os.waitid(os.P_PID, process.pid, os.WSTOPPED)
            time.sleep(0.06)  # for longer than it wanted to wait
            process.send_signal(signal.SIGCONT)
            os.waitid(os.P_PID, process.pid, os.WCONTINUED)
        process.send_signal(signal.SIGTERM)
        assert process.stdout.read() == f"{int(signal.SIGTERM)}\n"
        assert process.wait(10.0) == 0
