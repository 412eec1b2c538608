"""Continues a run where its journal ends: the state after its last slot, and the agents that took part."""

from __future__ import annotations

from typing import TYPE_CHECKING

from zengrid.errors import JournalError
from zengrid.scenario import HomeSpec, dumps
from zengrid_clock.agent_registry import AgentRegistry, MarketAgent

if TYPE_CHECKING:
    from zengrid.journal import RosterRecord, RunWriter
    from zengrid.scenario import Scenario
    from zengrid_clock.live_market import LiveMarket
    from zengrid_clock.run_state import RunState


def restore(run: RunWriter, scenario: Scenario, state: RunState, registry: AgentRegistry, market: LiveMarket) -> int:
    """Bring a new clock to the state that its journal ends with.

    The agents of the old clock reconnect by themselves. The journal knows which process plays which agent, so they
    take part in the next slot without joining again.

    Returns
    -------
    The version of the last roster; 0 before the first slot.

    Raises
    ------
    JournalError
        If the run was begun with another scenario.
    """
    if run.scenario() != dumps(scenario):
        raise JournalError(
            f"run = {run.name}: was begun with another scenario or seed; resume with the same one, or begin anew"
        )
    last = run.last()
    if last is None:
        return 0
    roster = run.roster(last.roster_version)
    slices = _restore_agents(registry, roster, {agent.id for agent in scenario.agents})
    market.restore([HomeSpec.model_validate(spec) for spec in roster.specs], slices, last)
    state.position = last.position + 1
    state.buy_price = last.buy_price
    state.day, state.slot = last.day, last.slot
    state.day, state.slot = state.following()
    state.last_record = last
    state.totals = run.totals()
    market.begin_day(state.day, state.slot)
    return roster.version


def _restore_agents(registry: AgentRegistry, roster: RosterRecord, scenario_agents: set[str]) -> dict[str, slice]:
    """Register the agents of a roster; return where each one's homes stand in the arrays."""
    slices: dict[str, slice] = {}
    start = 0
    registry.prosumers.clear()
    for name, homes, instance in roster.agents:
        if name == registry.grid.id:
            registry.grid.instance = instance
            continue
        slices[name] = slice(start, start + len(homes))
        start += len(homes)
        registry.prosumers[name] = MarketAgent(
            name, "prosumer", brought_homes=name not in scenario_agents, instance=instance, played_last_slot=True
        )
    return slices
