"""Every motion file format keeps its contract; and a broken one is told."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from poseloom.formats import FORMATS, Format
from poseloom.samples import sample_motions
from poseloom.testing import check_format

ASF = """:version 1.10
:units
  length 0.45
  angle deg
:root
  order TX TY TZ RX RY RZ
  axis XYZ
  position 0 0 0
  orientation 0 0 0
:bonedata
  begin
    id 1
    name thigh
    direction 0 -1 0
    length 7
    axis 0 0 0 XYZ
    dof rx ry rz
  end
:hierarchy
  begin
    root thigh
  end
"""


def _amc(folder: Path) -> Path:
    (folder / "take.asf").write_text(ASF)
    rows = "".join(f"{i + 1}\nroot 1 17 {i} 10 20 30\nthigh 5 6 {i}\n" for i in range(8))
    (folder / "take.amc").write_text(f":FULLY-SPECIFIED\n:DEGREES\n{rows}")
    return folder / "take.amc"


def _expmap(folder: Path) -> Path:
    joints = [{"name": "Hips", "parent": None, "offset": [0, 0, 0]}]
    bones = {"metres_per_unit": 0.01, "frame_rate_hz": 60, "joints": joints}
    (folder / "skeleton.json").write_text(json.dumps(bones))
    (folder / "take.csv").write_text("".join(f"{i}.5,90,1,0.1,0.2,0.3\n" for i in range(8)))
    return folder / "take.csv"


def _deepmimic(folder: Path) -> Path:
    frames = [[0.03, 0.0, 0.9, 0.1 * i, 1, 0, 0, 0, *([1, 0, 0, 0] * 3), 0, *([1, 0, 0, 0] * 2), 0,
               *([1, 0, 0, 0]), 0, *([1, 0, 0, 0] * 2), 0] for i in range(8)]  # fmt: skip
    (folder / "take.json").write_text(json.dumps({"Loop": "wrap", "Frames": frames}))
    return folder / "take.json"


EXAMPLES: dict[str, Callable[[Path], Path]] = {"amc": _amc, "expmap": _expmap, "deepmimic": _deepmimic}
"""Sound files of formats that are only read."""


@pytest.mark.parametrize("name", FORMATS.own)
def test_every_format_keeps_its_contract(name: str, tmp_path: Path) -> None:
    (tmp_path / "example").mkdir()
    example = EXAMPLES[name](tmp_path / "example") if name in EXAMPLES else None
    check_format(FORMATS[name], tmp_path, example)


def _raise(*arguments: object) -> None:
    raise KeyError("frames")


BVH = FORMATS["bvh"]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"recognise": lambda head: 0.5}, "not sure of"),
        ({"recognise": lambda head: 1.0 if head else 1 / 0}, "recognise raises ZeroDivisionError"),
        ({"write": lambda motion, path: path.write_bytes(b"x")}, "FileNotFoundError"),
        ({"read": lambda path, options: replace(sample_motions()["walk"].cut(0, 10), rate=30.0)}, "rate of 30"),
        ({"read": lambda path, options: sample_motions()["walk"].cut(5, 15)}, "mm away"),
        ({"read": lambda path, options: sample_motions()["walk"].cut(0, 10)}, "no bytes: a motion is read"),
        ({"write": None}, "give check_format an example"),
    ],
)
def test_a_broken_format_is_told(changes: dict, words: str, tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match=words):
        check_format(replace(BVH, **changes), tmp_path)


@pytest.mark.parametrize(
    "lack",
    [{"name": ""}, {"suffixes": ()}, {"suffixes": ("BVH",)}, {"read": None, "write": None}, {"takes": ("ears",)}],
)
def test_an_incomplete_row_is_an_error_when_it_is_made(lack: dict) -> None:
    with pytest.raises(TypeError):
        replace(BVH, **lack)


def test_one_format_that_fails_leaves_the_others_their_files() -> None:
    failing = Format("failing", (".x",), _raise, _raise)
    assert failing.likelihood(b"abc") == 0.0
    assert np.isclose(BVH.likelihood(b""), 1.0)
