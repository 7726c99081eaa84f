"""Tables of numbers in text files, with the line of whatever is wrong."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.errors import FormatError
from poseloom.formats._files import decode, read_bytes

_MISSING = ("", "nan", "NaN", "NA", "null")


@dataclass(frozen=True, eq=False)
class Table:
    """Named columns of a text file.

    Attributes:
        file: The file.
        heads: The header rows that stood above the numbers, the column names last.
        rows: The cells as text.
        first_line: Line of the first row, counted from 1.
        comments: The comment lines at the top, without their marks.
    """

    file: Path
    heads: tuple[tuple[str, ...], ...]
    rows: list[list[str]]
    first_line: int
    comments: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """The column names."""
        return self.heads[-1]

    def columns(self, places: Sequence[int]) -> Floats[Array, "rows columns"]:
        """Columns as numbers; empty cells and those that say so are NaN.

        Raises:
            FormatError: with the line, for a cell that is no number.
        """
        values = np.full((len(self.rows), len(places)), np.nan)
        for i, row in enumerate(self.rows):
            for j, place in enumerate(places):
                cell = row[place].strip()
                if cell in _MISSING:
                    continue
                try:
                    values[i, j] = float(cell)
                except ValueError:
                    raise FormatError(
                        f"{cell[:40]!r} in column {self.names[place]!r} is not a number",
                        cause="the file is damaged, or another program's",
                        remedy="Mend or cut out that line",
                        file=self.file,
                        line=self.first_line + i,
                    ) from None
        return values

    def find(self, *names: str) -> list[int]:
        """Places of columns.

        Raises:
            FormatError: if one is missing.
        """
        missing = [name for name in names if name not in self.names]
        if missing:
            raise FormatError(
                f"there is no column {missing[0]!r}",
                cause=f"the columns are {', '.join(self.names)[:200]}",
                remedy="Export the recording with that column",
                file=self.file,
                line=self.first_line - 1,
            )
        return [self.names.index(name) for name in names]


def read_table(path: Path, heads: int = 1, comment: str = "//") -> Table:
    """Reads a table with comments, then header rows, then rows of as many cells; tabs or commas between cells.

    A last line that was cut off is dropped if it is the file's last and does not end.

    Raises:
        FormatError: with the line, for a missing or empty file, no header, no row, or a row of another length.
    """
    content = read_bytes(path)
    text = decode(content)
    lines = text.splitlines()
    if not text.endswith(("\n", "\r")):
        lines = lines[:-1] if len(lines) > 1 and _is_short(lines) else lines
    comments: list[str] = []
    while lines and lines[0].startswith(comment):
        comments.append(lines.pop(0).removeprefix(comment).strip())
    if len(lines) <= heads:
        raise FormatError(
            "there is no sample in this file",
            cause="it was cut off after its header" if lines else "it holds comments only",
            remedy="Export the recording again",
            file=path,
        )
    separator = "\t" if "\t" in lines[heads - 1] else ","
    parsed = list(csv.reader((line.replace("\0", "") for line in lines), delimiter=separator))
    titles = tuple(tuple(cell.strip() for cell in row) for row in parsed[:heads])
    first_line = len(comments) + heads + 1
    rows = parsed[heads:]
    while rows and not any(rows[-1]):
        rows.pop()
    for i, row in enumerate(rows):
        if len(row) != len(titles[-1]):
            raise FormatError(
                f"this line has {len(row)} cells, the header has {len(titles[-1])}",
                cause="the file is damaged, or a line was cut off",
                remedy="Mend or cut out that line",
                file=path,
                line=first_line + i,
            )
    return Table(path, titles, rows, first_line, tuple(comments))


def _is_short(lines: list[str]) -> bool:
    """Whether the last line has fewer cells than the one before."""
    return lines[-1].count(",") + lines[-1].count("\t") < lines[-2].count(",") + lines[-2].count("\t")
