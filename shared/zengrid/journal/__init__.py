"""What is settled, and the state to resume from."""

from zengrid.journal.block import Block
from zengrid.journal.journal import Journal
from zengrid.journal.record import SlotRecord
from zengrid.journal.roster import Roster
from zengrid.journal.run import Run
from zengrid.journal.totals import TOTALS, Totals
from zengrid.journal.view import RunInfo, RunView

__all__ = ["TOTALS", "Block", "Journal", "Roster", "Run", "RunInfo", "RunView", "SlotRecord", "Totals"]
