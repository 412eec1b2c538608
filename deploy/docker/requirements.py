"""Prints what an image installs: ``python requirements.py market|learn``, run beside pyproject.toml."""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path

EXTRAS = {"market": ("postgres",), "learn": ("postgres", "learn", "env")}
DESK_ONLY = {"matplotlib", "pandas", "pvlib", "scipy"}
"""What no service of a market loads: figures, PV models of sites, reference solutions. A third of the image."""


def requirements(target: str) -> list[str]:
    """The requirements of an image, as pip reads them."""
    project = tomllib.loads(Path("pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted = list(project["dependencies"])
    if target == "market":
        wanted = [line for line in wanted if re.split(r"[^A-Za-z0-9._-]", line, maxsplit=1)[0] not in DESK_ONLY]
    for extra in EXTRAS[target]:
        wanted += project["optional-dependencies"][extra]
    return wanted


if __name__ == "__main__":
    sys.stdout.write("\n".join(requirements(sys.argv[1])) + "\n")
