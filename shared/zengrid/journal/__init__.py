"""What is settled, and the state to resume from."""

from zengrid.journal.block import Block
from zengrid.journal.journal import Journal
from zengrid.journal.record import SlotRecord
from zengrid.journal.roster import Roster
from zengrid.journal.run import Run
from zengrid.journal.totals import RunTotals
from zengrid.journal.view import RunInfo, RunView

__all__ = ["Block", "Journal", "Roster", "Run", "RunInfo", "RunTotals", "RunView", "SlotRecord"]
