"""How all figures look, and how they are written: PNG, SVG, and their data beside them."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    import pandas as pd

INK, PAPER = "#111112", "#fffffe"
"""Text and ground. No other part has these colours, so that a web page can put its own in their place."""
GREY = "#8a8a8a"
HOMES = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00")
"""Of Okabe and Ito (2008): told apart by the colour-blind."""
AGENTS, LEADER = "#d55e00", "#8856a7"
DASHES = ((), (5, 2), (1.5, 1.5), (6, 2, 1.5, 2), (3, 1), (8, 3))
"""Lines of homes differ in more than their colour."""

_STYLE: Any = {
    "font.family": "DejaVu Sans", "font.size": 9.0, "axes.titlesize": 9.5, "axes.titleweight": "bold",
    "axes.titlelocation": "left", "axes.labelsize": 9.0, "axes.spines.top": False, "axes.spines.right": False,
    "axes.linewidth": 0.8, "axes.edgecolor": INK, "axes.labelcolor": INK, "axes.titlecolor": INK, "text.color": INK,
    "xtick.color": INK, "ytick.color": INK, "figure.facecolor": PAPER, "axes.facecolor": "none",
    "savefig.facecolor": PAPER, "axes.grid": True, "axes.axisbelow": True,
    "grid.color": GREY, "grid.alpha": 0.25, "grid.linewidth": 0.6,
    "legend.frameon": False, "legend.fontsize": 8.5, "lines.linewidth": 1.7, "lines.markersize": 4.0,
    "svg.hashsalt": "zengrid", "svg.fonttype": "path", "path.simplify": True, "savefig.dpi": 160,
}  # fmt: skip


@contextmanager
def style() -> Iterator[None]:
    """Figures made in here look alike."""
    with mpl.rc_context(_STYLE):
        yield


def panels(count: int, width: float, height: float, rows: int = 1, **more: Any) -> tuple[Figure, list[Axes]]:
    """A figure of so many inches, with so many panels in a row or in several."""
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots(rows, -(-count // rows), squeeze=False, **more)
    return figure, list(axes.flat)


def band(axes: Axes, x: ArrayLike, values: NDArray[np.float64], colour: str, label: str = "", **line: Any) -> None:
    """The median over the first axis of ``(seed, x)``, and the range from the smallest to the largest."""
    if len(values) > 1:
        axes.fill_between(np.asarray(x), values.min(axis=0), values.max(axis=0), color=colour, alpha=0.18, linewidth=0)
    axes.plot(np.asarray(x), np.median(values, axis=0), color=colour, label=label, **line)


def legend(figure: Figure, axes: Sequence[Axes], columns: int = 5) -> None:
    """One legend below all panels; what several of them label the same stands there once."""
    found: dict[str, Artist] = {}
    for one in axes:
        for handle, label in zip(*one.get_legend_handles_labels(), strict=True):
            found.setdefault(label, handle)
    figure.legend(list(found.values()), list(found), loc="outside lower center", ncols=min(len(found), columns))


def letter(axes: Sequence[Axes], titles: Sequence[str]) -> None:
    """Title panels (a), (b) and so on."""
    for one, mark, title in zip(axes, "abcdefghijkl", titles, strict=False):
        one.set_title(f"({mark}) {title}")


def save(figure: Figure, data: pd.DataFrame, stem: Path) -> None:
    """Write ``stem.png``, ``stem.svg`` and the numbers in it as ``stem.csv``."""
    stem.parent.mkdir(parents=True, exist_ok=True)
    with style():
        figure.savefig(stem.with_suffix(".png"))
        text = io.StringIO()
        figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None})
    stem.with_suffix(".svg").write_text(_shorter(text.getvalue()), encoding="utf-8")
    data.to_csv(stem.with_suffix(".csv"), index=False)


def _shorter(svg: str) -> str:
    """Coordinates to a tenth of a thousandth of an inch: nobody sees more, and files are half as large."""
    return re.sub(r"-?\d+\.\d{3,}", lambda found: f"{float(found[0]):.2f}".rstrip("0").rstrip("."), svg)


def inline(svg: str) -> str:
    """An SVG to stand in a page: its ground is the page's, its ink the colour of the text around it."""
    body = svg[svg.index("<svg") :]
    return body.replace(PAPER, "none").replace(INK, "currentColor")
