"""How fast agents learn: agent steps and gradient updates per CPU-second, beside Stable-Baselines3 and CleanRL's way.

Run it on a quiet machine: ``python benchmarks/throughput.py --peers ../shared/peers --json throughput.json``. Without
``--peers`` it measures zengrid alone. One thread; the peers need ``pip install stable-baselines3``. They play a toy
home of 4 numbers and 5 actions; zengrid plays the whole market (settlement, observations, 4 agents, learning included).
"""

from __future__ import annotations

import argparse
import json
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import Any

BATCHES = (32, 64, 128, 256)


def main() -> None:
    """Measure, print a table, write JSON."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--peers", type=Path, help="folder with b_sb3_dqn.py and b_cleanrl_dqn.py")
    options.add_argument("--json", type=Path, help="where to write the results")
    options.add_argument("--seconds", type=float, default=3.0, help="of each of three repetitions")
    chosen = options.parse_args()
    os.environ["OMP_NUM_THREADS"] = "1"
    rows = [zengrid(seeds, batch, chosen.seconds) for seeds in (1, 5) for batch in BATCHES]
    if chosen.peers:
        for name in ("b_sb3_dqn.py", "b_cleanrl_dqn.py"):
            rows += peer(chosen.peers / name)
    print(f"{'per CPU-second':58}{'agent steps':>12}{'updates, all networks':>23}{'each network':>14}")
    for row in rows:
        print(f"{row['name']:58}{row['agent_steps']:12,.0f}{row['updates']:23,.0f}{row['updates_each']:14,.0f}")
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"peak memory of zengrid: {peak_mb:.0f} MB")
    if chosen.json:
        chosen.json.write_text(json.dumps({"rows": rows, "peak_mb": peak_mb}, indent=1))


def zengrid(seeds: int, batch: int, seconds: float) -> dict[str, Any]:
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
    for _ in range(3):
        start, first = time.process_time(), training.step
        while time.process_time() - start < seconds:
            training.day()
        rates.append((training.step - first) / (time.process_time() - start))
    rate = median(rates)
    return {
        "name": f"zengrid, 64 days x {seeds} seeds, batch {batch}",
        "agent_steps": rate * settings.days * seeds * 4,
        # Each of the networks, four a seed, is updated once in a vector step.
        "updates": rate * seeds * 4,
        "updates_each": rate,
        "batch": batch,
    }


def peer(script: Path) -> list[dict[str, Any]]:
    """The lines a peer's script prints, in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        # They write their results beside themselves.
        for file in script.parent.glob("*.py"):
            (Path(folder) / file.name).write_bytes(file.read_bytes())
        done = subprocess.run(
            [sys.executable, script.name], cwd=folder, capture_output=True, text=True, check=False, timeout=900
        )
    if done.returncode:
        raise SystemExit(f"{script.name} failed:\n{done.stderr[-2000:]}")
    rows = []
    for line in done.stdout.splitlines():
        said = json.loads(line)
        batch = re.search(r"batch=(\d+)", said["cfg"])
        rows.append(
            {
                "name": f"{said['bench']}, {said['cfg']}",
                "agent_steps": said["env_steps_per_cpu_s"],
                "updates": said["grad_steps_per_cpu_s"],
                "updates_each": said["grad_steps_per_cpu_s"],
                "batch": int(batch.group(1)) if batch else None,
            }
        )
    return rows


if __name__ == "__main__":
    main()
