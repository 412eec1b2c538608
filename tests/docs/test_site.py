"""The documentation builds, with every page in its navigation and no dead link or anchor."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from support.doc_pages import ROOT


def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    built = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path / "site")],
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        timeout=50.0,
    )
    assert built.returncode == 0, built.stderr
    assert (tmp_path / "site" / "protocol" / "schemas" / "FleetAction.json").exists()
