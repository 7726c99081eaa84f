"""Text of unknown origin: encodings, line ends."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from poseloom.formats._files import decode, split_lines

PLAIN = "time,acc_x\r\n0.00,1.5\r\n0.01,-2.5\r\n"


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "latin-1"])
def test_encodings_are_recognised(encoding: str) -> None:
    assert decode(PLAIN.encode(encoding)) == PLAIN


def test_a_mark_stands_before_big_endian_text_and_letters_survive() -> None:
    assert decode(b"\xfe\xff" + "Zeit;Größe\n1;2\n".encode("utf-16-be")) == "Zeit;Größe\n1;2\n"
    assert decode("Größe °/s\n".encode("latin-1")) == "Größe °/s\n"
    assert decode("Größe °/s\n".encode()) == "Größe °/s\n"


def test_blocks_of_zeros_that_a_memory_card_lost_are_no_utf_16() -> None:
    assert decode(b"\0" * 4096 + b"1,2,3\n").strip("\0") == "1,2,3\n"


@given(st.binary(max_size=200))
def test_decoding_never_fails(content: bytes) -> None:
    assert isinstance(decode(content), str)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r", "\r\r\n"])
def test_line_ends_of_all_systems(end: str) -> None:
    assert split_lines(end.join(["a", "b\x85c\x0cd", "e", ""])) == ["a", "b\x85c\x0cd", "e"]
    assert split_lines(end.join(["a", "e"])) == ["a", "e"]
