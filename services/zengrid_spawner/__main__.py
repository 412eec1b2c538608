"""``python -m zengrid_spawner``: start and supervise prosumer processes here, for whoever asks over Zenoh."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from queue import SimpleQueue

from zengrid import logs
from zengrid.bus.credentials import SPAWNER
from zengrid.bus.options import add_bus_options
from zengrid.bus.spawner_link import SpawnerLink
from zengrid.errors import ZengridError
from zengrid.processes.log import make_folder
from zengrid_spawner.service import Inbox, Spawner
from zengrid_spawner.settings import Settings, default_logs, default_name


def parser() -> argparse.ArgumentParser:
    """The command line of the spawner."""
    it = argparse.ArgumentParser(
        prog="zengrid spawner", description="Start and supervise prosumer processes here, for whoever asks over Zenoh."
    )
    add_bus_options(it)
    defaults = Settings()
    machine = default_name()
    it.add_argument("--name", help=f"of this spawner (default: this machine's, {machine}; with --certs {SPAWNER})")
    it.add_argument("--limit", type=int, default=defaults.limit, help="most processes (default: %(default)s)")
    it.add_argument(
        "--memory",
        type=float,
        default=defaults.memory_mb,
        metavar="MIB",
        help="most memory of all (default: %(default)g)",
    )
    it.add_argument(
        "--process-memory",
        type=float,
        default=defaults.process_memory_mb,
        metavar="MIB",
        help="a process that takes more is killed and started again (default: %(default)g)",
    )
    it.add_argument("--logs", type=Path, default=default_logs(), metavar="FOLDER", help="(default: %(default)s)")
    it.add_argument(
        "--policies", type=Path, metavar="FOLDER", help="policy files that prosumers may play, beside rules"
    )
    logs.add_log_options(it)
    return it


def main(arguments: list[str] | None = None) -> int:
    """Serve until a signal asks to stop."""
    options = parser().parse_args(arguments)
    logs.begin("spawner", options, run=options.run)
    settings = Settings(
        name=options.name or (default_name() if options.certs is None else SPAWNER),
        run=options.run,
        endpoint=options.connect,
        certs=options.certs,
        limit=options.limit,
        memory_mb=options.memory,
        process_memory_mb=options.process_memory,
        logs=options.logs,
        policies=options.policies,
    )
    try:
        make_folder(settings.logs)
        inbox: Inbox = SimpleQueue()
        with SpawnerLink(settings.name, settings.run, settings.endpoint, on_event=inbox.put, certs=settings.certs):
            what = f"up to {settings.limit} prosumers in run {settings.run} at {settings.endpoint}"
            logs.say(f"{settings.name} starts {what}")
            Spawner(settings, inbox).serve()
    except (ZengridError, OSError) as error:
        logs.fail(error)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
