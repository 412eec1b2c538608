"""A Zenoh router with a standard configuration file, as ``zenohd -c FILE`` is one: ``python zenoh_router.py FILE``.

``zenohd`` itself is no Python package; a session in mode ``router`` runs the same code.
"""

from __future__ import annotations

import signal
import sys

import zenoh

if __name__ == "__main__":
    with zenoh.open(zenoh.Config.from_file(sys.argv[1])):
        sys.stdout.write("ready\n")
        sys.stdout.flush()
        signal.sigwait([signal.SIGTERM, signal.SIGINT])
