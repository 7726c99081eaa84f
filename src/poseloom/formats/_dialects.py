"""What programs of other countries and systems do to a text of numbers: brought to one form before it is scanned."""

import re

from poseloom.formats._files import decode

_HEAD = 4096
_NUMERIC = re.compile(rb"(?:^|\n)[ \t]*(?:OFFSET\b|[-+.\d])[^\n]*", re.IGNORECASE)
_POINT = re.compile(rb"\d\.\d")
_DECIMAL_COMMA = re.compile(rb"\d,\d")


def utf8(content: bytes) -> bytes:
    """A text in UTF-8 or another 8-bit coding, from one that may be UTF-16 (as Windows shells write)."""
    wide = content.startswith((b"\xff\xfe", b"\xfe\xff")) or b"\0" in content[:_HEAD]
    return decode(content).encode() if wide else content


def plain_numbers(content: bytes) -> bytes:
    """A text of numbers with points for decimals and blanks between: commas and semicolons are told apart by use.

    A comma is a decimal sign where no number of the text has a point and digits follow it at once; else it separates,
    as semicolons do. Only lines that hold numbers are touched, so a joint may have a comma in its name.
    """
    if b"," not in content and b";" not in content:
        return content
    lines = _NUMERIC.findall(content)
    decimal = not any(_POINT.search(line) for line in lines) and any(_DECIMAL_COMMA.search(line) for line in lines)
    table = bytes.maketrans(b",;", b". " if decimal else b"  ")
    return _NUMERIC.sub(lambda found: found.group().translate(table), _time(content, decimal))


def _time(content: bytes, decimal: bool) -> bytes:
    """The frame time, whose line begins with words."""
    if not decimal:
        return content
    return re.sub(rb"(Frame\s+Time\s*:?\s*\d*),(?=\d)", rb"\1.", content, flags=re.IGNORECASE)
