"""The live table: what it shows, and that it fits every terminal and every market."""

from __future__ import annotations

from io import StringIO

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from support.sample_status import agent, status
from zengrid_cli.live_view.market_view import MarketView, bar, render


def shown(view: MarketView, width: int = 80, height: int = 24) -> list[str]:
    console = Console(file=StringIO(), width=width, color_system=None, highlight=False)
    with console.capture() as capture:
        console.print(render(view, height))
    return [line.rstrip() for line in capture.get().splitlines()]


def test_a_market_that_waits_for_its_journal_says_so() -> None:
    now = status(journal_waits=1, journal_wait_s=12.3)
    assert "waiting for the journal for 12 s" in shown(MarketView(now, now.homes))


def test_a_small_market_on_a_small_terminal() -> None:
    now = status(refused={"late": 3, "out_of_range": 1200})
    lines = shown(MarketView(now, now.homes, footer="http://127.0.0.1:8080   Ctrl-C ends the market"))
    assert lines == [
        "paper (main)  ● running  max  912 slots/s            day 2 14:00  slot 63 of 168",
        "import price 0.095 $/kWh  demand    23.40 kW  base       19.20 kW",
        "export price 0.070 $/kWh  export     4.20 kW  reserve     0.50 kW",
        "curtailed 0.00 kWh        unserved 0.25 kWh",
        "",
        "since the start                now        baseline         difference",
        "─────────────────────────────────────────────────────────────────────",
        "grid profit               137.00 $        100.00 $   +37.00   +37.0 %",
        "reserve energy           70.00 kWh      100.00 kWh   -30.00   -30.0 %",
        "bills of the homes         62.00 $        100.00 $   -38.00   -38.0 %",
        "",
        "home SoC        batt kW   PV kW load kW   bill $  base. $    diff.  policy",
        "────────────────────────────────────────────────────────────────────────────────",
        "h0   █▎    30%    -1.00    0.00    0.50    -1.00     0.00        –  conventional",
        "h1   ██    50%    +0.00    2.00    1.50     0.00     1.00 -100.0 %  conventional",
        "h2   ██▊   70%    +1.00    4.00    2.50     1.00     2.00  -50.0 %  conventional",
        "",
        "all  ██    50%    +0.00    6.00    4.50     0.00     3.00 -100.0 %  3 homes",
        "",
        "refused actions: 3 late, 1,200 out of range",
        "waited for the grid 1.2 ms (p99 1.2), homes 1.2 ms (p99 1.2)",
        "http://127.0.0.1:8080   Ctrl-C ends the market",
    ]


@given(
    sizes=st.lists(st.integers(1, 40), min_size=1, max_size=40),
    scale=st.sampled_from([1.0, 1e3, 1e5]),
    height=st.integers(24, 80),
    events=st.lists(st.just("12:00:00 prosumer a0: killed by SIGKILL; starting it again in 0.1 s" * 2), max_size=2),
)
def test_every_market_fits(sizes: list[int], scale: float, height: int, events: list[str]) -> None:
    now = status(sizes, scale=scale, refused={"late": 3})
    lines = shown(MarketView(now, now.homes, events=events, footer="Ctrl-C"), height=height)
    assert len(lines) <= height
    assert max(map(len, lines)) <= 80
    assert sum(line.startswith("all") for line in lines) == (sum(sizes) > 1)


def test_agents_instead_of_homes_where_homes_do_not_fit() -> None:
    now = status((50, 30, 20))
    lines = shown(MarketView(now, now.homes))
    assert [line[:2] for line in lines if line[:1] == "a" and line[1:2].isdigit()] == ["a0", "a1", "a2"]
    assert any(line.startswith("agent") for line in lines)
    assert any(line.endswith("100 homes") for line in lines)


def test_agents_in_trouble_come_first() -> None:
    now = status([1] * 50)
    agents = [*now.agents[:40], agent("a39", presence="absent", fallbacks=7), *now.agents[41:]]
    now = now.model_copy(update={"agents": tuple(agents)})
    lines = shown(MarketView(now, now.homes), width=120)
    row = next(i for i, line in enumerate(lines) if "absent, 7 missed" in line)
    assert lines[row].startswith("a39")
    assert "conventional" in lines[row + 1]
    assert "conventional" not in lines[row - 1]


def test_a_clock_that_is_away_is_said_to_be() -> None:
    now = status()
    assert "○ away for 3 s" in shown(MarketView(now, now.homes, away_s=3.2))[0]


def test_a_grid_agent_in_trouble_gets_a_line() -> None:
    now = status()
    away = agent("grid", 0, role="grid", policy="fixed", presence="away", fallbacks=4)
    now = now.model_copy(update={"agents": (away, *now.agents[1:])})
    assert "grid agent: away, fixed, 4 missed" in shown(MarketView(now, now.homes))


def test_a_market_before_its_first_slot_is_shown() -> None:
    now = status(last=None, state="waiting")
    lines = shown(MarketView(now, None))
    assert lines[0].endswith("before the first slot")
    assert "● waiting" in lines[0]


@pytest.mark.parametrize(
    ("part", "text"), [(0.0, "       0%"), (0.5, "██    50%"), (1.0, "████ 100%"), (1.7, "████ 170%"), (None, "–")]
)
def test_a_bar_shows_the_state_of_charge(part: float | None, text: str) -> None:
    assert bar(part).plain == text
