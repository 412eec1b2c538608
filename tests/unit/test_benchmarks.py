"""Benchmarks: each script explains itself, the index lists all, the quickest run, and the peers' check can fail."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "benchmarks"
SCRIPTS = sorted(FOLDER.glob("*.py"))
PEERS = [FOLDER / "peers" / f"{name}.py" for name in ("helics_market", "mosaik_market", "zenoh_market")]
PEER_LEARNERS = [FOLDER / "peers" / f"{name}.py" for name in ("cleanrl_dqn", "sb3_dqn")]


def run(script: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(script), *words], cwd=ROOT, capture_output=True, text=True, check=False, timeout=200
    )


@pytest.mark.parametrize("script", [*SCRIPTS, *PEERS, *PEER_LEARNERS], ids=lambda script: script.stem)
def test_every_script_has_help_that_names_its_command(script: Path) -> None:
    if script.stem in ("learning", "foresight", "throughput", "cleanrl_dqn", "sb3_dqn"):
        pytest.importorskip("torch")
    if script in PEER_LEARNERS:
        pytest.importorskip("gymnasium")
        pytest.importorskip("stable_baselines3")
    shown = run(script, "--help")
    assert shown.returncode == 0, shown.stderr
    assert f"python {script.relative_to(ROOT)}" in shown.stdout


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_every_script_says_which_claim_it_measures_how_long_it_takes_and_what_it_needs(script: Path) -> None:
    opening = " ".join(script.read_text(encoding="utf-8").split('"""')[1].split())
    for word in ("Claim", "docs/", "Takes ", "needs "):
        assert word.lower() in opening.lower(), f"{script.name}: its docstring lacks {word!r}"


def test_the_index_lists_all_scripts() -> None:
    index = (FOLDER / "README.md").read_text(encoding="utf-8")
    assert all(f"]({script.name})" in index and f"python benchmarks/{script.name}" in index for script in SCRIPTS)
    of_peers = (FOLDER / "peers" / "README.md").read_text(encoding="utf-8")
    assert all(
        f"`{script.name}`" in of_peers for script in (FOLDER / "peers").glob("*.py") if "dqn_r" not in script.name
    )


def test_the_quickest_script_runs(tmp_path: Path) -> None:
    done = run(FOLDER / "settle.py", "--quick", "--out", str(tmp_path / "settle.json"))
    assert done.returncode == 0, done.stderr
    results = json.loads((tmp_path / "settle.json").read_text())
    assert results["machine"]["cpus"] == os.cpu_count()
    assert all(seconds > 0.0 for seconds in results["seconds_a_slot"].values())
    assert set(results["seconds_a_slot"]) == {line.rpartition(":")[0] for line in done.stdout.splitlines()}


def test_bare_zenoh_settles_what_the_core_settles() -> None:
    done = run(FOLDER / "peers" / "zenoh_market.py", "--slots", "60", "--warm-up", "10", "--timeout", "150")
    assert done.returncode == 0, done.stderr
    row = json.loads(done.stdout)
    assert row["settlement"] == "70 slots settled, equal to zengrid's core to the last bit"
    assert row["slots_s"] > 0.0


def test_a_peer_that_settles_anything_else_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(FOLDER / "peers")
    from agent_rules import battery_kw, buy_price
    from same_market import Environment, check_settlement

    environment = Environment(3)
    for slot in range(36):
        grid, homes = environment.observe()
        error_kw = 1e-9 if slot == 33 else 0.0  # in the morning, when batteries are neither empty nor full
        price = buy_price(grid)
        environment.settle(price, [battery_kw(price, home) + error_kw for home in homes])
    assert check_settlement(3, environment.profits[:33], environment.bills[:33]).startswith("33 slots settled")
    with pytest.raises(SystemExit, match="slot 33: the peer settled"):
        check_settlement(3, environment.profits, environment.bills)
