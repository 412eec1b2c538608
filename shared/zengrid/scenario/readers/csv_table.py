"""Reads a CSV file as named columns; errors name the line and column."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from zengrid.errors import ScenarioError

Floats = NDArray[np.float64]


class CsvTable:
    """Columns of a file with a header line.

    Parameters
    ----------
    path:
        The file, comma-separated, UTF-8.
    rename:
        Other names that a column may have in the file, and the name that is used instead.

    Raises
    ------
    ScenarioError
        The file cannot be read, is empty, repeats a column, or has a line of another length than the header.
    """

    def __init__(self, path: Path, rename: dict[str, str] | None = None) -> None:
        self.path = path
        try:
            lines = path.read_text(encoding="utf-8-sig").splitlines()
        except OSError as error:
            raise ScenarioError(f"{path}: cannot be read ({error.strerror or error}); needed: a CSV file") from None
        except UnicodeDecodeError as error:
            raise ScenarioError(f"{path}: is not a CSV file in UTF-8 ({error})") from None
        if not lines or not lines[0].strip(", "):
            raise ScenarioError(f"{path}: the file is empty; needed: a header line and at least one whole day")
        header = [name.strip() for name in next(csv.reader(lines[:1]))]
        self.header = tuple((rename or {}).get(name, name) for name in header)
        if len(self.header) == 1 and ";" in header[0]:
            raise ScenarioError(f'{path}, line 1: columns are separated by ";"; permitted: "," (and "." in numbers)')
        for position, name in enumerate(self.header):
            if name in self.header[:position]:
                raise ScenarioError(f'{path}, line 1: column "{name}" appears twice; permitted: once')
        self._lines: Sequence[int] = range(2, len(lines) + 1)
        if "" in lines:
            self._lines = [number for number in self._lines if lines[number - 1]]
        self.columns = self._split([line for line in lines[1:] if line])

    def _split(self, body: list[str]) -> dict[str, Sequence[str]]:
        if not body:
            raise ScenarioError(f"{self.path}: only a header; needed: at least one whole day below it")
        width = len(self.header)
        if any('"' in line for line in body):
            rows = list(csv.reader(body))
            self._check_widths([len(row) for row in rows])
            return dict(zip(self.header, zip(*rows, strict=True), strict=True))
        # A flat list of cells: one list a line takes three times as long for a year of measurements.
        self._check_widths([line.count(",") + 1 for line in body])
        cells = ",".join(body).split(",")
        return {name: cells[position::width] for position, name in enumerate(self.header)}

    def _check_widths(self, widths: list[int]) -> None:
        needed = len(self.header)
        if set(widths) != {needed}:
            row = next(i for i, width in enumerate(widths) if width != needed)
            raise ScenarioError(
                f"{self.path}, line {self._lines[row]}: {widths[row]} values; needed: {needed}, as in the header"
            )

    def __len__(self) -> int:
        return len(self._lines)

    def text(self, column: str) -> Sequence[str]:
        """The cells of a column as in the file."""
        if column not in self.columns:
            there = ", ".join(self.header)
            raise ScenarioError(f'{self.path}, line 1: column "{column}" is missing; there are: {there}')
        return self.columns[column]

    def numbers(self, column: str, minimum: float = 0.0) -> Floats:
        """A column of finite numbers, none below ``minimum``."""
        cells = self.text(column)
        try:
            values = np.fromiter(map(float, cells), dtype=np.float64, count=len(cells))
        except ValueError:
            row = next(i for i, cell in enumerate(cells) if not _is_number(cell))
            what = "the value is missing" if not cells[row].strip() else f'"{cells[row]}" is not a number'
            raise self.error(row, column, f"{what}; permitted: a number from {minimum:g} up") from None
        good = np.isfinite(values) & (values >= minimum)
        if not good.all():
            row = int(np.argmin(good))
            raise self.error(
                row, column, f"{cells[row].strip()} is out of range; permitted: a number from {minimum:g} up"
            )
        return values

    def error(self, row: int, column: str, message: str) -> ScenarioError:
        """Return an error about one cell; ``row`` counts from 0 below the header."""
        return ScenarioError(f'{self.path}, line {self._lines[row]}, column "{column}": {message}')


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
