"""Goes on where a journal ends: the state after its last slot, and who was taking part."""

from __future__ import annotations

from typing import TYPE_CHECKING

from zengrid.errors import JournalError
from zengrid.scenario import HomeSpec
from zengrid_clock.roster import Agent

if TYPE_CHECKING:
    from zengrid_clock.service import Clock


def restore(clock: Clock) -> None:
    """Bring a new clock to the state that its journal ends with.

    The agents of the old clock reconnect by themselves; since the journal knows which process speaks for whom, they are
    in the next slot again without joining anew.
    """
    run, market = clock.run, clock.market
    if run.scenario() != clock.scenario.dump():
        raise JournalError(
            f"run = {run.name}: was begun with another scenario or seed; resume with the same one, or begin anew"
        )
    last = run.last()
    if last is None:
        return
    roster = run.roster(last.roster_version)
    specs = [HomeSpec.model_validate(spec) for spec in roster.specs]
    slices: dict[str, slice] = {}
    start = 0
    scenario_agents = {agent.id for agent in clock.scenario.agents}
    clock.roster.prosumers.clear()
    for name, homes, instance in roster.agents:
        if name == clock.roster.grid.id:
            clock.roster.grid.instance = instance
            continue
        slices[name] = slice(start, start + len(homes))
        start += len(homes)
        agent = Agent(name, "prosumer", brought=name not in scenario_agents, instance=instance)
        agent.settled = True
        clock.roster.prosumers[name] = agent
    market.restore(specs, slices, last)
    clock.desk.roster_version = roster.version
    clock.position = last.position + 1
    clock.buy_price = last.buy_price
    clock.day, clock.slot = last.day, last.slot + 1
    if clock.slot == clock.scenario.slots_per_day:
        clock.day, clock.slot = last.day + 1, 0
    market.begin_day(clock.day, clock.slot)
    clock.last_record = last
    clock.observer.settled(last.day, last.slot, last.buy_price)
    clock.totals = run.totals()
