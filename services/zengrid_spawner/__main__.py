"""``python -m zengrid_spawner``: starts and supervises prosumer processes on request over Zenoh."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from queue import SimpleQueue

from zengrid import logs
from zengrid.command_line.bus_options import add_bus_options
from zengrid.command_line.command_parser import CommandParser
from zengrid.command_line.log_options import add_log_options
from zengrid.command_line.run_command import run_command
from zengrid.command_line.value_parsers import Number, WholeNumber
from zengrid.errors import BusError


def parser() -> CommandParser:
    """Make the parser of the command line."""
    it = CommandParser(
        prog="zengrid spawner",
        description="Start and supervise prosumer processes on this machine on request, such as from the web page.",
        examples=["zengrid spawner", "zengrid spawner --name lab --limit 16 --policies policies"],
    )
    add_bus_options(it.add_argument_group("network"))
    it.add_argument(
        "--name", metavar="NAME", help="name of this spawner (default: this machine's name; with --certs spawner)"
    )
    it.add_argument("--limit", type=WholeNumber(1), default=64, metavar="N", help="largest number of processes")
    it.add_argument(
        "--memory",
        type=Number(above=True, unit="MiB"),
        default=8192.0,
        metavar="MIB",
        help="largest memory of all processes together (default: %(default)g MiB)",
    )
    it.add_argument(
        "--process-memory",
        type=Number(above=True, unit="MiB"),
        default=512.0,
        metavar="MIB",
        help="a process that takes more memory than this is killed and restarted (default: %(default)g MiB)",
    )
    it.add_argument(
        "--logs",
        type=Path,
        metavar="FOLDER",
        help="folder of the processes' log files (default: ~/.local/state/zengrid/spawner)",
    )
    it.add_argument(
        "--policies", type=Path, metavar="FOLDER", help="policy files that prosumers may use, beside the rules"
    )
    add_log_options(it)
    return it


def main(arguments: Sequence[str]) -> int:
    """Serve until a signal asks to stop."""
    options = parser().parse_args(arguments)
    logs.configure("spawner", options, run=options.run)
    # Loaded after the command line has been checked: they load numpy.
    from zengrid.bus.credentials import SPAWNER
    from zengrid.bus.spawner_link import SpawnerLink
    from zengrid.processes.process_log import make_log_folder
    from zengrid_spawner.service import Inbox, Spawner
    from zengrid_spawner.settings import Settings, default_logs, default_name

    settings = Settings(
        name=options.name or (default_name() if options.certs is None else SPAWNER),
        run=options.run,
        endpoint=options.connect,
        certs=options.certs,
        limit=options.limit,
        memory_mb=options.memory,
        process_memory_mb=options.process_memory,
        logs=options.logs or default_logs(),
        policies=options.policies,
    )
    try:
        make_log_folder(settings.logs)
    except OSError as error:
        raise BusError(f"--logs {settings.logs}: {error.strerror}") from None
    inbox: Inbox = SimpleQueue()
    with SpawnerLink(settings.name, settings.run, settings.endpoint, on_event=inbox.put, certs=settings.certs):
        what = f"up to {settings.limit} prosumers in run {settings.run} at {settings.endpoint}"
        logs.print_message(f"{settings.name} starts {what}")
        Spawner(settings, inbox).serve()
    return 0


if __name__ == "__main__":
    sys.exit(run_command("spawner", main, sys.argv[1:]))
