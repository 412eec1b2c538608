"""The commands of ``zengrid``, and the modules that run them: nothing else imports a module by its name."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import TYPE_CHECKING, NamedTuple, Protocol, cast

if TYPE_CHECKING:
    from zengrid.command_line.command_parser import CommandParser


class CommandModule(Protocol):
    """What the module of a command has."""

    def parser(self) -> CommandParser:
        """Make the parser of the command line."""

    def main(self, arguments: Sequence[str]) -> int:
        """Run the command with the arguments after its name; return the exit code."""


class Command(NamedTuple):
    """One command.

    ``module`` has ``parser`` and ``main``, see ``CommandModule``. Services are named by their package: services do not
    import each other. ``role`` is the first argument for a module that runs several commands.
    """

    module: str
    help: str
    role: str = ""

    def load(self) -> CommandModule:
        """Import the module of the command."""
        return cast("CommandModule", import_module(self.module))

    def arguments(self, arguments: Sequence[str]) -> list[str]:
        """The arguments for the module, of the arguments after the name of the command."""
        return [self.role, *arguments] if self.role else list(arguments)


CLOCK, AGENT, GATEWAY, SPAWNER = "zengrid_clock", "zengrid_agent", "zengrid_gateway", "zengrid_spawner"
"""Packages of the services: ``python -m PACKAGE`` starts one."""
_COMMANDS = "zengrid_cli.commands"

GROUPS: dict[str, dict[str, Command]] = {
    "Run and watch a market": {
        "up": Command(f"{_COMMANDS}.up_command", "run a whole market on this machine"),
        "top": Command(f"{_COMMANDS}.top_command", "watch a running market"),
        "control": Command(f"{_COMMANDS}.control_command", "pause, resume, step, speed up or stop a market"),
        "scenario": Command(f"{_COMMANDS}.scenario_command", "show, check and export scenarios"),
        "export": Command(f"{_COMMANDS}.export_command", "write a run of the journal as CSV or Parquet"),
        "journal": Command(f"{_COMMANDS}.journal_command", "verify, back up and prune a journal"),
    },
    "Train and evaluate agents": {
        "train": Command(f"{_COMMANDS}.train_command", "train agents in a simulated market"),
        "evaluate": Command(f"{_COMMANDS}.evaluate_command", "compare policies with the best possible ones"),
        "sweep": Command(f"{_COMMANDS}.sweep_command", "train with many values of settings and many seeds"),
        "reproduce": Command(f"{_COMMANDS}.reproduce_command", "reproduce all figures and numbers of the paper"),
    },
    "Run the parts of a market one by one": {
        "clock": Command(f"{CLOCK}.__main__", "the clock: time, settlement and journal"),
        "grid": Command(f"{AGENT}.__main__", "the grid agent", role="grid"),
        "prosumer": Command(f"{AGENT}.__main__", "a prosumer agent, also for a running market", role="prosumer"),
        "gateway": Command(f"{GATEWAY}.__main__", "the web page and the HTTP interface"),
        "spawner": Command(f"{SPAWNER}.__main__", "start prosumers on this machine on request"),
        "certs": Command(f"{_COMMANDS}.certs_command", "make certificates for a market on a network"),
        "health": Command(f"{_COMMANDS}.health_command", "check the connection of a process to its market"),
    },
    "More": {
        "completion": Command(f"{_COMMANDS}.completion_command", "print a completion script for your shell"),
    },
}
COMMANDS: dict[str, Command] = {name: command for group in GROUPS.values() for name, command in group.items()}


def preload_agents() -> None:
    """Import what agents need, before ``zengrid up`` forks their processes."""
    import_module(f"{AGENT}.preload")


def load_parser(name: str) -> CommandParser:
    """Make the parser of a command."""
    command = COMMANDS[name]
    parser = command.load().parser()
    return parser.subcommands()[command.role] if command.role else parser
