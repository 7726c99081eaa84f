"""The first half of a BVH file: its hierarchy of joints and their channels."""

import math
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn

import numpy as np

from poseloom.arrays import Array, Floats, Ints
from poseloom.errors import FormatError

_TOKEN = re.compile(r"[{}]|[^\s{}]+")
_KEYWORDS = frozenset(("HIERARCHY", "ROOT", "JOINT", "END", "OFFSET", "CHANNELS"))
CHANNELS = ("Xposition", "Yposition", "Zposition", "Xrotation", "Yrotation", "Zrotation")
"""Channel names; the first three are positions, and each three are in the order of the axes."""
_CODES = {name.lower(): code for code, name in enumerate(CHANNELS)}


@dataclass
class BvhJoint:
    """A joint as a BVH file states it, in the file's units; filled while its block is read.

    Attributes:
        name: The rest of its ROOT or JOINT line.
        parent: Index of its parent, -1 for the root.
        line: Where it begins.
        offset: Its OFFSET; None until read.
        channels: For each of its channels, in order, the index in `CHANNELS`.
        tip: The OFFSET of its End Site, if it has one.
    """

    name: str
    parent: int
    line: int
    offset: Floats[Array, "3"] | None = None
    channels: list[int] = field(default_factory=list[int])
    tip: Floats[Array, "3"] | None = None

    @property
    def positions(self) -> list[int]:
        """Places, among its channels, of those that are positions."""
        return [place for place, code in enumerate(self.channels) if code < 3]

    @property
    def rotations(self) -> list[int]:
        """Places, among its channels, of those that are rotations, in order."""
        return [place for place, code in enumerate(self.channels) if code >= 3]


def parse_hierarchy(text: str, path: Path) -> list[BvhJoint]:
    """Joints in the order of the file, which is also the order of the motion's columns.

    Args:
        text: From the file's first line up to its MOTION line.
        path: For errors.

    Raises:
        FormatError: with the line, for anything that is not a hierarchy with one root.
    """
    return _Parser(text, path).joints()


class _Parser:
    """Reads tokens one after the other; each block of the file is a method."""

    def __init__(self, text: str, path: Path) -> None:
        self._path = path
        self._tokens = [
            (token, line) for line, content in enumerate(text.split("\n"), start=1) for token in _TOKEN.findall(content)
        ]
        self._next = 0
        self._joints: list[BvhJoint] = []

    def joints(self) -> list[BvhJoint]:
        if self._take("HIERARCHY") != "HIERARCHY":
            self._fail("a BVH file begins with the word HIERARCHY", cause="this is another kind of file")
        self._open_joint(-1)
        if self._next < len(self._tokens):
            self._fail(
                f"after the root's block comes {self._tokens[self._next][0]!r} instead of MOTION",
                cause="the hierarchy has more than one root, or a brace too many",
            )
        return self._joints

    def _open_joint(self, parent: int) -> None:
        """One ROOT or JOINT block and all blocks in it. Open blocks are kept in a list: depth is no limit."""
        open_blocks = [parent]
        while True:
            keyword = self._take("ROOT, JOINT, End Site, OFFSET, CHANNELS or a brace")
            at_root = len(self._joints) == 0
            if keyword in ("ROOT", "JOINT"):
                if (keyword == "ROOT") != at_root:
                    self._fail(
                        "the first joint must be the ROOT" if at_root else "there is a second ROOT",
                        cause="a skeleton has one root, to which all other joints are connected",
                    )
                self._joints.append(BvhJoint(self._name(keyword), open_blocks[-1], self._line))
                open_blocks.append(len(self._joints) - 1)
                continue
            if at_root:
                self._fail(f"the hierarchy begins with {keyword!r}, not with ROOT")
            joint = self._joints[open_blocks[-1]]
            if keyword == "OFFSET":
                joint.offset = self._vector()
            elif keyword == "CHANNELS":
                joint.channels = self._channels(joint)
            elif keyword == "END":
                tip = self._end_site()
                joint.tip = tip if joint.tip is None else joint.tip
            elif keyword == "}":
                if joint.offset is None:
                    self._fail(f"joint {joint.name!r} has no OFFSET")
                open_blocks.pop()
                if len(open_blocks) == 1:
                    return
            else:
                self._fail(f"{keyword!r} is not a word of a BVH hierarchy")

    @property
    def _line(self) -> int:
        return self._tokens[max(self._next - 1, 0)][1] if self._tokens else 1

    def _take(self, wanted: str) -> str:
        """The next token, keywords in capitals."""
        token = self._raw(wanted)
        capitals = token.upper()
        return capitals if capitals in _KEYWORDS else token

    def _raw(self, wanted: str) -> str:
        """The next token as it stands there."""
        if self._next >= len(self._tokens):
            self._fail(
                f"the hierarchy ends where {wanted} should come", cause="the file is cut off or a brace is missing"
            )
        self._next += 1
        return self._tokens[self._next - 1][0]

    def _name(self, keyword: str) -> str:
        """What stands between a keyword and its brace; names may hold blanks."""
        words: list[str] = []
        while (word := self._raw("an opening brace")) != "{":
            if word == "}" or (words and word.upper() in ("OFFSET", "CHANNELS")):
                self._fail(f"the block of {keyword} {' '.join(words)!r} has no opening brace")
            words.append(word)
        if not words and keyword != "END":
            self._fail(f"{keyword} has no name")
        return " ".join(words)

    def _end_site(self) -> Floats[Array, "3"]:
        self._name("END")
        if self._take("OFFSET") != "OFFSET":
            self._fail("an End Site holds an OFFSET and nothing else")
        tip = self._vector()
        if self._take("a closing brace") != "}":
            self._fail("an End Site holds an OFFSET and nothing else")
        return tip

    def _vector(self) -> Floats[Array, "3"]:
        values: list[float] = []
        for _ in range(3):
            word = self._raw("a number")
            try:
                values.append(float(word))
            except ValueError:
                self._fail(f"OFFSET needs three numbers, but {word[:40]!r} is none")
        if not all(map(math.isfinite, values)):
            self._fail("an OFFSET is not finite")
        return np.array(values)

    def _channels(self, joint: BvhJoint) -> list[int]:
        word = self._raw("the number of channels")
        if word not in "0123456" or len(word) != 1:
            self._fail(f"CHANNELS needs a number from 0 to 6, not {word[:40]!r}")
        codes: list[int] = []
        for _ in range(int(word)):
            channel = self._raw("a channel's name")
            if channel.lower() not in _CODES:
                self._fail(
                    f"joint {joint.name!r} has {channel!r} where one of its {word} channels should stand",
                    remedy=f"Channels are {', '.join(CHANNELS)}; their number must be right",
                )
            codes.append(_CODES[channel.lower()])
        positions, rotations = [c for c in codes if c < 3], [c for c in codes if c >= 3]
        if len(set(positions)) < len(positions) or len(rotations) > 3:
            self._fail(f"joint {joint.name!r} has a doubled position channel or more than three rotations")
        return codes

    def _fail(
        self, fact: str, cause: str = "", remedy: str = "Mend the hierarchy or export the file again"
    ) -> NoReturn:
        raise FormatError(fact, cause=cause, remedy=remedy, file=self._path, line=self._line)


def rotation_columns(joints: list[BvhJoint]) -> tuple[Ints[Array, "joints 3"], Ints[Array, "joints 3"]]:
    """For each joint the motion's columns of its turns, and their axes 0 to 2; -1 where it has fewer than three."""
    columns, axes = np.full((len(joints), 3), -1), np.full((len(joints), 3), -1)
    first = 0
    for index, joint in enumerate(joints):
        for turn, place in enumerate(joint.rotations):
            columns[index, turn], axes[index, turn] = first + place, joint.channels[place] - 3
        first += len(joint.channels)
    return columns, axes
