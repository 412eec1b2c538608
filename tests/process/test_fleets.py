"""One process, many homes: both encodings carry the same bits, and a fleet is asked for any of its homes."""

from __future__ import annotations

import numpy as np
import pytest

from zengrid.errors import RefusedError
from zengrid.journal import Journal, SlotRecord
from zengrid.journal.audit import audit
from zengrid.testing import RunningMarket
from zengrid.wire.queries import PolicyRequest


def village_day(encoding: str) -> list[SlotRecord]:
    """A day of a hundred homes in two fleets."""
    with RunningMarket("village", ("--days", "1", "--deadline", "20")) as market:
        market.start_grid("--policy", "random:1")
        for fleet in ("fleet1", "fleet2"):
            market.start_prosumer(fleet, "--policy", "random:2", "--encoding", encoding)
        assert market.processes["clock"].end(40) == 0
        with Journal.open(market.journal, read_only=True) as journal:
            run = journal.run()
            assert audit(run) == []
            return run.records()


def test_both_encodings_settle_the_same_bits() -> None:
    by_json, binary = village_day("json"), village_day("binary")
    assert len(by_json) == 24
    for one, other in zip(by_json, binary, strict=True):
        assert not one.fallback.any()
        assert not other.fallback.any()
        assert len(one.soc) == 100
        assert one.battery_kw.tobytes() == other.battery_kw.tobytes()
        assert one.bill.tobytes() == other.bill.tobytes()


def test_agents_say_what_they_would_do() -> None:
    with RunningMarket("paper", ("--paused",)) as market:
        market.start_agents("p1", "p2", "p3", grid_policy="tou:0.05,18:00=0.09")
        market.wait_for_status(lambda s: s.state == "paused", missing="the market ready")
        evening = (0.0, -1.0)  # sine and cosine of 12 hours after midnight
        rows = ((0.5, 3.0, 1.0, 0.05, *evening, 0.095), (0.5, 0.0, 5.0, 0.05, *evening, 0.095))
        reply = market.client.ask_policy("p1", PolicyRequest(observations=rows))
        assert reply.policy == "conventional"
        assert reply.actions == (2.0, -2.0)
        assert reply.features == ("soc", "pv_kw", "load_kw", "buy_price", "time_sin", "time_cos", "sell_price")
        at_19 = (float(np.sin(2 * np.pi * 19 / 24)), float(np.cos(2 * np.pi * 19 / 24)))
        price = market.client.ask_policy("grid", PolicyRequest(observations=((0.1, 0.2, 0.0, 3, 20.0, *at_19, 0.095),)))
        assert price.actions == (0.09,)
        with pytest.raises(RefusedError, match=r"observations\.0 has 2 numbers: give 7"):
            market.client.ask_policy("p1", PolicyRequest(observations=((0.5, 0.1),)))
        with pytest.raises(RefusedError, match="home = p9: p1 plays p1"):
            market.client.ask_policy("p1", PolicyRequest(observations=rows, home="p9"))
