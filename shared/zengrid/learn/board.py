"""What TensorBoard shows of a training, where it is installed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from zengrid.learn.run import Report

MOST_HOMES = 12


class Board:
    """Curves of every market in a folder for ``tensorboard --logdir``."""

    def __init__(self, folder: Path) -> None:
        self._writer: Any = None
        try:
            from torch.utils.tensorboard import SummaryWriter
        except ImportError:
            return  # it is worth having, and nothing depends on it
        self._writer = SummaryWriter(str(folder))

    def add(self, report: Report) -> None:
        """Add an evaluation."""
        if self._writer is None:
            return
        for place, changes in enumerate(report.now):
            self._writer.add_scalar(f"profit_percent/{place}", changes.profit, report.step)
            self._writer.add_scalar(f"reserve_percent/{place}", changes.reserve, report.step)
            self._writer.add_scalar(f"joint_gain_percent/{place}", changes.joint_gain, report.step)
            for home, bill in enumerate(changes.bill[:MOST_HOMES]):
                self._writer.add_scalar(f"bill_percent/{place}/{home}", bill, report.step)

    def close(self) -> None:
        """Write what is left."""
        if self._writer is not None:
            self._writer.close()
