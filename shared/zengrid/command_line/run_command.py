"""Runs a command and turns what it raises into an exit code and one sentence on stderr."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Callable, Sequence

from zengrid import logs
from zengrid.errors import EXIT_FAILED, EXIT_INTERNAL, EXIT_INTERRUPTED, EXIT_USAGE, ZengridError


def run_command(name: str, main: Callable[[Sequence[str]], int], arguments: Sequence[str]) -> int:
    """Run the main function of a command and return the exit code of the process.

    Parameters
    ----------
    name:
        Name of the command in error messages.
    main:
        Takes the arguments and returns an exit code.
    """
    logs.set_service(name)
    try:
        return main(arguments)
    except ZengridError as error:
        logs.print_error(error)
        return EXIT_FAILED
    except BrokenPipeError:
        # The reader of the output has closed it, such as head; Python would complain when it flushes at the end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
    except SystemExit as end:
        # The command line was wrong, or asked for help.
        return end.code if isinstance(end.code, int) else EXIT_USAGE if end.code else 0
    except Exception as error:  # noqa: BLE001 - an error of the program, as opposed to one that the user can correct
        logs.print_error("".join(traceback.format_exception(error)))
        return EXIT_INTERNAL
