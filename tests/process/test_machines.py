"""Agents and a spawner on other machines, over cables with latency and loss that are cut: the market goes on."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from support.certificate_folders import make_certs
from support.network_hosts import NetworkHosts, why_not
from zengrid.journal import Journal
from zengrid.journal.audit import audit
from zengrid.scenario.home_spec import HomeSpec
from zengrid.testing import RunningMarket, free_port
from zengrid.wire.spawner_queries import SpawnRequest
from zengrid_cli.commands.certs_command import main as certs_command

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]

DEADLINE_S = 1.0
SLACK_S = 3.0
"""What a busy test machine may add to a deadline."""
ROUTER = Path(__file__).parents[1] / "support" / "zenoh_router.py"


@pytest.fixture(scope="module")
def hosts() -> Iterator[NetworkHosts]:
    reason = why_not()
    if reason is not None:
        pytest.skip(reason)
    with NetworkHosts("west", "east") as hosts:
        yield hosts


@pytest.mark.parametrize("through", ["direct", "router"])
def test_agents_elsewhere_take_part_fall_back_when_cut_off_and_return(
    through: str, hosts: NetworkHosts, tmp_path: Path
) -> None:
    certs = make_certs(tmp_path / "certs", "--host", hosts.here, "--host", hosts.address("east"), "--spawner", "east")
    market = RunningMarket("paper", ("--deadline", str(DEADLINE_S), "--wait", "60"), certs=certs)
    market.endpoint = f"tls/{hosts.here}:{free_port()}"
    for name in hosts.names:
        hosts.quality(name, delay_s=0.01, loss=0.01)
    with market:
        there = market.endpoint
        if through == "router":
            assert certs_command([str(certs), "--router", market.endpoint, "--run", market.run]) == 0
            there = f"tls/{hosts.address('east')}:7447"
            # The file as it was written; it names certificates in its own folder.
            route = f"cd {certs} && exec {sys.executable} {ROUTER} router.json5"
            market.start("router", *hosts.on("east", "sh", "-c", route))

        def elsewhere(name: str, host: str, module: str, *words: str) -> None:
            market.start(name, *hosts.on(host, sys.executable, "-m", module, *words, "--connect", there))

        market.start_agents("p3")
        elsewhere("p1", "west", "zengrid_agent", "prosumer", "--id", "p1")
        elsewhere("p2", "east", "zengrid_agent", "prosumer", "--id", "p2")
        logs = str(tmp_path / "spawner")
        elsewhere("spawner", "east", "zengrid_spawner", "--name", "east", "--logs", logs)
        everyone = {"grid", "p1", "p2", "p3"}
        market.wait_for_slot(lambda slot: everyone <= set(slot.acted), 60, "a slot of everyone")

        until = time.monotonic() + 60
        while "east" not in {spawner.spawner for spawner in market.client.spawners()}:
            assert time.monotonic() < until, "no spawner"
            market.wait_for_slots(1)
        # A second spawner on another machine starts a home there, if it has a certificate for it.
        home = HomeSpec.model_validate({"id": "p4", "pv_kw": 3, "battery": {"capacity_kwh": 5}})
        assert market.client.spawn("east", SpawnRequest(home=home)).state == "running"
        everyone |= {"p4"}
        market.wait_for_slot(lambda slot: everyone <= set(slot.acted), 60, "a slot of everyone, p4 too")

        hosts.cut("west")
        market.wait_for_slot(
            lambda slot: "p1" in slot.fallback and everyone - {"p1"} <= set(slot.acted), 60, "a slot without p1"
        )
        # Until the cable's end is noticed p1 is waited for; after that the others play at their own pace.
        market.wait_for_status(
            lambda s: next(a for a in s.agents if a.id == "p1").presence != "present", 30, "p1 given up"
        )
        market.wait_for_slots(20, 60)
        hosts.quality("west", delay_s=0.01, loss=0.01)
        market.wait_for_slot(lambda slot: everyone <= set(slot.acted), 60, "p1 back, by itself")

        hosts.cut("east")
        gone = {"p2", "p4"} | ({"p1"} if through == "router" else set())
        market.wait_for_slot(
            lambda slot: gone <= set(slot.fallback) and everyone - gone <= set(slot.acted),
            60,
            f"a slot without {gone}",
        )
        hosts.quality("east", delay_s=0.01, loss=0.01)
        market.wait_for_slot(lambda slot: everyone <= set(slot.acted), 60, "everyone back")

        market.client.control("stop")
        assert market.processes["clock"].end(20) == 0
        with Journal.open(market.journal, read_only=True) as journal:
            run = journal.run()
            assert audit(run) == []
            times = np.concatenate([block["settled_at"] for block in run.blocks(homes=False)])
            # Two phases a slot, each of which waits for one deadline at most.
            assert float(np.diff(times).max()) < 2 * DEADLINE_S + SLACK_S
