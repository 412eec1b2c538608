"""The journal of settled slots, from which a market resumes."""

from zengrid.journal.block import Block
from zengrid.journal.journal import Journal
from zengrid.journal.roster_record import RosterRecord
from zengrid.journal.run_view import RunInfo, RunView
from zengrid.journal.run_writer import RunWriter
from zengrid.journal.slot_record import SlotRecord
from zengrid.journal.totals import RunTotals

__all__ = ["Block", "Journal", "RosterRecord", "RunInfo", "RunTotals", "RunView", "RunWriter", "SlotRecord"]
