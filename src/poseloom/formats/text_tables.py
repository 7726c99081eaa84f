"""Tables of numbers in text files of any dialect, with the line of whatever is wrong.

Cells are parted by tabs, semicolons, bars, commas or blanks, quoted or not; numbers have decimal points or, as in many
European exports, decimal commas; the text is in any encoding (`_files.decode`). Delimiters at line ends, empty lines
and comments are passed over. What cannot be told apart (decimal commas between commas, both marks in one file) is
refused.
"""

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.errors import FormatError
from poseloom.formats._files import decode, read_bytes, split_lines

_MISSING = frozenset(("", "nan", "na", "n/a", "#n/a", "null", "none", "-", "--"))
_DELIMITERS = ("\t", ";", "|", ",", " ")
"""In the order in which they are tried: a comma may also be a decimal mark, a blank may stand anywhere."""
_COMMENTS = ("//", "#", "%")
_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?")
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
_DECLARED = re.compile(r'"?sep=(.)"?', re.IGNORECASE)
_LOOKED_AT = 60
"""Lines from which the dialect is told."""
_MOST_HEADS = 3


@dataclass(frozen=True, eq=False)
class Table:
    """Named columns of a text file.

    Attributes:
        file: The file.
        heads: The header rows that stood above the numbers, in the file's order.
        rows: The cells as text, each row as long as the headers.
        lines: The line of each row, counted from 1.
        comments: The comment lines above the header, without their marks.
        delimiter: What parts the cells.
        decimal: The decimal mark, a point or a comma.
    """

    file: Path
    heads: tuple[tuple[str, ...], ...]
    rows: list[list[str]]
    lines: list[int]
    comments: tuple[str, ...]
    delimiter: str
    decimal: str

    @property
    def names(self) -> tuple[str, ...]:
        """The column names: the last header row."""
        return self.heads[-1]

    @property
    def dialect(self) -> str:
        """The dialect in words, where it is another than commas and points; empty otherwise."""
        words = {"\t": "tabs", ";": "semicolons", "|": "bars", " ": "blanks"}
        parts = [f"{words[self.delimiter]} between cells"] if self.delimiter in words else []
        return ", ".join([*parts, "decimal commas"] if self.decimal == "," else parts)

    def columns(self, places: Sequence[int]) -> Floats[Array, "rows columns"]:
        """Columns as numbers; empty cells and those that say so are NaN.

        Raises:
            FormatError: with the line, for a cell that is no number.
        """
        values = np.full((len(self.rows), len(places)), np.nan)
        for i, row in enumerate(self.rows):
            for j, place in enumerate(places):
                cell = row[place]
                if cell.lower() in _MISSING:
                    continue
                try:
                    values[i, j] = float(cell.replace(",", ".") if self.decimal == "," else cell)
                except ValueError:
                    raise self._no_number(cell, place, i) from None
        return values

    def _no_number(self, cell: str, place: int, row: int) -> FormatError:
        cause = "the file is damaged, or another program's"
        if "," in cell and "." in cell:
            cause = "it has a comma and a point: groups of digits are not read"
        elif cell.count(",") == 1:
            cause = "some numbers of this file have decimal points, others decimal commas"
        return FormatError(
            f"{cell[:40]!r} in column {self.names[place][:40]!r} is not a number",
            cause=cause,
            remedy="Mend or cut out that line",
            file=self.file,
            line=self.lines[row],
        )

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
                line=self.lines[0] - 1,
            )
        return [self.names.index(name) for name in names]


def read_table(path: Path, heads: int | None = None) -> Table:
    """Reads a table: comments, header rows, then rows of as many cells.

    A last line that was cut off, without an end and with fewer cells, is dropped.

    Args:
        path: The file.
        heads: Header rows; left out, all rows without numbers directly above the first one with numbers, up to three.

    Raises:
        FormatError: with the line, for a missing or empty file, no header, no row, or a row of another length.
    """
    text = decode(read_bytes(path)).replace("\0", "")
    return table_of_lines(split_lines(text), path, heads, ended=text.endswith(("\n", "\r")))


def table_of_lines(
    lines: Sequence[str], path: Path, heads: int | None = None, *, first_line: int = 1, ended: bool = True
) -> Table:
    """The table in some lines; see `read_table`.

    Args:
        lines: The lines.
        path: For the table and its errors.
        heads: Header rows; found if left out.
        first_line: Line of the file of the first.
        ended: Whether the last line had an end.
    """
    comments: list[str] = []
    at = 0
    declared = ""
    while at < len(lines):
        text = lines[at].strip()
        mark = next((mark for mark in _COMMENTS if text.startswith(mark)), "")
        if found := _DECLARED.fullmatch(text):
            declared = found.group(1)
        elif mark:
            comments.append(text.removeprefix(mark).strip())
        elif text:
            break
        at += 1
    numbered = [(first_line + i, lines[i]) for i in range(at, len(lines)) if lines[i].strip()]
    delimiter = declared or find_delimiter([line for _, line in numbered[:_LOOKED_AT]])
    cells = [(line, split_cells(text, delimiter)) for line, text in numbered]
    if cells and heads is None and comments and _is_numeric(cells[0][1]):
        # numpy and MATLAB write the column names as the last comment
        named = split_cells(comments[-1], delimiter)
        if len(named) == len(cells[0][1]) and not _is_numeric(named):
            cells.insert(0, (cells[0][0] - 1, named))
            comments.pop()
    titles, body = _headed(cells, heads)
    if not titles or not body:
        raise FormatError(
            "there is no sample in this file" if titles or not body else "this table has no header",
            cause="it was cut off after its header" if cells else "it holds comments only",
            remedy="Export the recording again, with the names of its columns",
            file=path,
        )
    rows = _squared(titles, body, path, ended, delimiter)
    return Table(
        path,
        tuple(tuple(title) for title in titles),
        [row for _, row in rows],
        [line for line, _ in rows],
        tuple(comments),
        delimiter,
        _decimal([row for _, row in rows], delimiter),
    )


def split_cells(line: str, delimiter: str) -> list[str]:
    """The cells of one line, without blanks around them; a quotation mark that stays open ends with its line."""
    if delimiter == " ":
        return line.split()
    if '"' in line:
        try:
            parts = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), list[str]())
        except csv.Error:  # a field beyond the csv module's limit
            parts = line.replace('"', "").split(delimiter)
    else:
        parts = line.split(delimiter)
    return [part.strip() for part in parts]


def is_number(cell: str) -> bool:
    """Whether a cell holds a number, with a decimal point or comma."""
    return _NUMBER.fullmatch(cell) is not None


def _is_numeric(cells: Sequence[str]) -> bool:
    """Whether a line is one of numbers: half of what stands in it, the first cell left out (a time may be words)."""
    filled = [cell for cell in cells[1:] if cell.lower() not in _MISSING or cell.lower() == "nan"]
    return len(filled) > 0 and sum(is_number(cell) or cell.lower() == "nan" for cell in filled) >= 0.5 * len(filled)


def find_delimiter(lines: Sequence[str]) -> str:
    """The first delimiter that parts at least half of the lines into as many cells, numbers below names."""
    for delimiter in _DELIMITERS:
        split = [_trimmed(split_cells(line, delimiter)) for line in lines]
        numeric = Counter(len(cells) for cells in split if len(cells) > 1 and _is_numeric(cells))
        if numeric and 2 * sum(numeric.values()) >= len([cells for cells in split if cells]) - _MOST_HEADS:
            return delimiter
    counts = {delimiter: sum(line.count(delimiter) for line in lines) for delimiter in _DELIMITERS[:-1]}
    return max(counts, key=lambda delimiter: counts[delimiter])


def _trimmed(cells: list[str]) -> list[str]:
    last = len(cells)
    while last > 0 and not cells[last - 1]:
        last -= 1
    return cells[:last]


def _headed(
    cells: list[tuple[int, list[str]]], heads: int | None
) -> tuple[list[list[str]], list[tuple[int, list[str]]]]:
    """The header rows and the rows below them."""
    if heads is not None:
        return [row for _, row in cells[:heads]], cells[heads:]
    numeric = [
        (i, len(_trimmed(row))) for i, (_, row) in enumerate(cells[:_LOOKED_AT]) if len(row) > 1 and _is_numeric(row)
    ]
    usual = Counter(width for _, width in numeric).most_common(1)
    first = next((i for i, width in numeric if width == usual[0][0]), len(cells))  # not a number in a preamble
    if first == len(cells):
        return [row for _, row in cells[:1]], cells[1:]
    width = len(_trimmed(cells[first - 1][1])) if first else 0
    begin = first
    while begin > 0 and first - begin < _MOST_HEADS:
        row = cells[begin - 1][1]
        # A row of sensors may have fewer names than there are columns; a preamble is parted otherwise.
        if len(row) < width or len(row) < 2:
            break
        begin -= 1
    return [row for _, row in cells[begin:first]], cells[first:]


def _squared(
    titles: list[list[str]], body: list[tuple[int, list[str]]], path: Path, ended: bool, delimiter: str
) -> list[tuple[int, list[str]]]:
    """The rows, each as long as the header, which loses its empty names at the end; titles are changed in place."""
    width = len(titles[-1])
    filled = max((len(_trimmed(row)) for _, row in body[:_LOOKED_AT]), default=0)
    if not any(any(title[filled:]) for title in titles):
        width = min(width, filled)
    for title in titles:
        title[:] = [*title, *[""] * width][:width]
    rows = [(line, row[:width] if len(row) > width and not any(row[width:]) else row) for line, row in body]
    while rows and not any(rows[-1][1]):
        rows.pop()
    if len(rows) > 1 and not ended and len(rows[-1][1]) < width:
        rows.pop()
    for line, row in rows:
        if len(row) != width:
            commas = delimiter == "," and len(row) >= 2 * width - 1
            raise FormatError(
                f"this line has {len(row)} cells, the header has {width}",
                cause="commas stand between the cells and within the numbers, which cannot be told apart"
                if commas
                else "the file is damaged, or a line was cut off",
                remedy="Export it with decimal points, or with semicolons between the cells"
                if commas
                else "Mend or cut out that line",
                file=path,
                line=line,
            )
    if not rows:
        raise FormatError(
            "there is no sample in this file",
            cause="it was cut off after its header",
            remedy="Export the recording again",
            file=path,
        )
    return rows


def _decimal(rows: list[list[str]], delimiter: str) -> str:
    """The decimal mark of all numbers; a point where both occur, so that the others are told as what they are."""
    if delimiter == "," and not any("," in cell for row in rows for cell in row):
        return "."
    commas = any(_DECIMAL_COMMA.fullmatch(cell) for row in rows for cell in row)
    points = any("." in cell and is_number(cell) for row in rows for cell in row)
    return "," if commas and not points else "."
