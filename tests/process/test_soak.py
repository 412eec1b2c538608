"""A minute of faults at random, then the audit; half an hour of it is in docs/measurements/endurance.md."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_a_minute_of_faults_loses_nothing(tmp_path: Path) -> None:
    out = tmp_path / "soak.json"
    command = [sys.executable, "benchmarks/soak.py", "--minutes", "1", "--faults-per-minute", "60", "--seed", "7"]
    done = subprocess.run(
        [*command, "--out", str(out)], cwd=ROOT, capture_output=True, text=True, check=False, timeout=380
    )
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr[-4000:]}"
    result = json.loads(out.read_text())
    assert result["faults"] >= 3
    assert all(row["recovered"] == row["faults"] for row in result["recovery"])
    assert result["slots"] > 10
