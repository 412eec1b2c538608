"""Folders of certificates for tests."""

from __future__ import annotations

from pathlib import Path

from zengrid_cli.commands.certs_command import main


def make_certs(folder: Path, *words: str) -> Path:
    """An authority with everyone of the paper's scenario, and two more agents."""
    assert main([str(folder), "--scenario", "paper", "--spare", "2", *words]) == 0
    return folder
