"""What the DQN peers share: their options, and the rates they print, one line of JSON for each configuration."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import median
from typing import NamedTuple

import torch

from home_env import check_bills


class Timed(NamedTuple):
    """What one run did after its warm-up."""

    agent_steps: int
    updates: int
    cpu_s: float


Configuration = tuple[str, int, Callable[[int], Timed]]
"""A name, its batch size, and a function that runs so many agent steps."""


class CpuTimer:
    """CPU time of this process from its making on."""

    def __init__(self) -> None:
        self._began = time.process_time()

    def stop(self, agent_steps: int, updates: int) -> Timed:
        """What was done since."""
        return Timed(agent_steps, updates, time.process_time() - self._began)


def run_peer(doc: str | None, script: str, system: str, configurations: Sequence[Configuration]) -> None:
    """Check the environment, run every configuration, print medians.

    Parameters
    ----------
    doc, script:
        The script's docstring and file.
    system:
        What is measured, with its version.
    configurations:
        What to run, one after the other.
    """
    parser = argparse.ArgumentParser(
        prog=f"python benchmarks/peers/{Path(script).name}",
        description=doc,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--steps", type=int, default=5000, help="agent steps of a run (default: %(default)s)")
    parser.add_argument("--rounds", type=int, default=3, help="runs of each configuration (default: %(default)s)")
    options = parser.parse_args()
    torch.set_num_threads(1)
    print(check_bills(), file=sys.stderr)
    for name, batch, run in configurations:
        runs = [run(options.steps) for _ in range(options.rounds)]
        row = {
            "name": f"{system}, {name}",
            "batch": batch,
            "agent_steps": median(timed.agent_steps / timed.cpu_s for timed in runs),
            "updates": median(timed.updates / timed.cpu_s for timed in runs),
        }
        print(json.dumps(row), flush=True)
