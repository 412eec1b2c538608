"""How every benchmark script begins and ends: its options, its results as JSON with notes on the machine."""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
"""The checkout this benchmark belongs to."""


def script_parser(doc: str | None, script: str) -> argparse.ArgumentParser:
    """Make the parser of a script, with the option ``--out``.

    Parameters
    ----------
    doc:
        The script's docstring, which ``--help`` prints.
    script:
        Its ``__file__``; results go to ``benchmarks/results/NAME.json`` by default.
    """
    name = Path(script).stem
    parser = argparse.ArgumentParser(
        prog=f"python benchmarks/{name}.py", description=doc, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=ROOT / "benchmarks" / "results" / f"{name}.json",
        metavar="FILE",
        help=f"where to write the results (default: benchmarks/results/{name}.json)",
    )
    return parser


def parse_options(parser: argparse.ArgumentParser, quick: Mapping[str, Any]) -> argparse.Namespace:
    """Parse the command line; ``--quick`` replaces defaults, and options given explicitly still win.

    Parameters
    ----------
    parser:
        From ``script_parser``.
    quick:
        Values of options for a smoke run, by the names they have in the namespace.
    """
    shown = " ".join(f"{name}={value}" for name, value in quick.items())
    parser.add_argument(
        "--quick", action="store_true", help=f"smoke run, whose numbers mean nothing: {shown}".replace("%", "%%")
    )
    if "--quick" in sys.argv[1:]:
        parser.set_defaults(**quick)
    return parser.parse_args()


def machine() -> dict[str, Any]:
    """Describe where the numbers come from."""
    return {
        "cpus": os.cpu_count(),
        "load_1_min": round(os.getloadavg()[0], 2),
        "platform": platform.platform(),
        "python": platform.python_version(),
    }


def write_results(out: Path, **results: Any) -> None:
    """Write results and notes on the machine as JSON."""
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(json.dumps({"machine": machine(), **results}, indent=1) + "\n", encoding="utf-8")
    print(f"results: {out}", file=sys.stderr)
