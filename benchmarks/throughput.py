"""Agent steps and gradient updates per CPU-second, beside Stable-Baselines3 and CleanRL's way.

    python benchmarks/throughput.py --peers

Claim: docs/measurements/performance.md ("Learning throughput"). Takes 4 minutes, 2 without the peers; needs torch, and
benchmarks/peers/requirements.txt for the peers. Run it on a machine with nothing else to do.

One thread each. zengrid plays and settles the whole market of four agents and trains all of them, with plain replay and
one batch size; the peers train on one home of the same scenario, in the cheapest environment (benchmarks/peers/).
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import time
from statistics import median
from typing import Any

from kit.script import ROOT, parse_options, script_parser, write_results

BATCHES = (32, 64, 128, 256)
PEER_SCRIPTS = ("sb3_dqn.py", "cleanrl_dqn.py")
AGENTS = 4
"""Of the scenario ``paper``."""


def main() -> None:
    """Measure, print a table, write the figures."""
    parser = script_parser(__doc__, __file__)
    parser.add_argument("--peers", action="store_true", help="measure Stable-Baselines3 and CleanRL's way, too")
    parser.add_argument("--batches", type=int, nargs="+", default=list(BATCHES))
    parser.add_argument("--seconds", type=float, default=3.0, help="of each run [CPU-s] (default: %(default)g)")
    parser.add_argument("--rounds", type=int, default=3, help="runs of each configuration (default: %(default)s)")
    parser.add_argument("--steps", type=int, default=5000, help="agent steps of a peer's run (default: %(default)s)")
    options = parse_options(parser, {"batches": [32], "seconds": 0.2, "rounds": 1, "steps": 500})
    os.environ["OMP_NUM_THREADS"] = "1"
    rows = [
        measure_zengrid(seeds, batch, options.seconds, options.rounds) for seeds in (1, 5) for batch in options.batches
    ]
    for script in PEER_SCRIPTS if options.peers else ():
        rows += measure_peer(script, options.steps, options.rounds)
    print(f"{'per CPU-second':58}{'agent steps':>12}{'updates, all networks':>23}{'each network':>14}")
    for row in rows:
        print(f"{row['name']:58}{row['agent_steps']:12,.0f}{row['updates']:23,.0f}{row['updates_each']:14,.0f}")
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"peak memory of zengrid: {peak_mb:.0f} MB")
    write_results(options.out, rows=rows, peak_mb=peak_mb)


def measure_zengrid(seeds: int, batch: int, seconds: float, rounds: int) -> dict[str, Any]:
    """The preset ``fast`` with plain replay for all agents and one batch size: 64 days of the paper's market a seed."""
    import torch

    from zengrid.learn.settings import Settings
    from zengrid.learn.training import Training
    from zengrid.scenario import load

    torch.set_num_threads(1)
    settings = Settings.preset("fast").with_(batch=batch, own_model=False, n_step=1, steps=10**9)
    training = Training([load("paper")] * seeds, range(seeds), settings)
    for _ in range(3):
        training.day()
    rates = []
    for _ in range(rounds):
        start, first = time.process_time(), training.step
        while time.process_time() - start < seconds:
            training.day()
        rates.append((training.step - first) / (time.process_time() - start))
    rate = median(rates)
    return {
        "name": f"zengrid, 64 days x {seeds} seeds, batch {batch}",
        "agent_steps": rate * settings.days * seeds * AGENTS,
        # Every agent of every seed has a network, which is updated once in a vector step.
        "updates": rate * seeds * AGENTS,
        "updates_each": rate,
        "batch": batch,
    }


def measure_peer(script: str, steps: int, rounds: int) -> list[dict[str, Any]]:
    """The rows a peer's script prints, in a process of its own."""
    command = [sys.executable, str(ROOT / "benchmarks" / "peers" / script)]
    command += ["--steps", str(steps), "--rounds", str(rounds)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=900)
    if done.returncode:
        raise SystemExit(f"{script} failed:\n{done.stderr[-2000:]}")
    print(done.stderr, end="", file=sys.stderr)
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    return [{**row, "updates_each": row["updates"]} for row in rows]


if __name__ == "__main__":
    main()
