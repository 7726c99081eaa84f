"""The contract of a motion file format."""

import shutil
from pathlib import Path

import numpy as np

from poseloom.errors import PoseloomError
from poseloom.formats.motions import read_as
from poseloom.formats.table import HEAD, Format
from poseloom.samples import sample_motions
from poseloom.skeleton.kinematics import motion_frames
from poseloom.skeleton.motion import Motion

_CLOSE = 1e-3
"""Metres by which a joint may be elsewhere after writing and reading."""
_HARMS = 16


def check_format(kind: Format, folder: Path, example: Path | None = None, motion: Motion | None = None) -> None:
    """Checks that a format keeps its contract.

    - What is written and read again has every joint within 1 mm, and the same frames and rate.
    - `recognise` is sure of a sound file, and never raises.
    - A file that is empty, cut, changed or of another kind, a folder and a missing file end in a PoseloomError that
      names the file, or are read as finite numbers.
    - Writing where nothing can be written ends in a PoseloomError that names the file.

    Args:
        kind: The format.
        folder: An empty folder for files.
        example: A sound file, in a folder with what belongs to it and nothing else; needed where the format is only
            read.
        motion: What is written and read; ten frames of a walk if left out.

    Raises:
        AssertionError: naming what is broken, and with which file.
    """
    motion = motion or sample_motions()["walk"].cut(0, 10)
    if kind.write is not None:
        written = folder / "written" / f"a take{kind.suffixes[0]}"
        written.parent.mkdir()
        kind.write(motion, written)
        _ensure(written.is_file() and written.stat().st_size > 0, f"nothing was written to {written}")
        left = sorted(file.name for file in written.parent.iterdir())
        _ensure(left == [written.name], f"writing left {', '.join(left)} in its folder")
        _check_refuses_to_write(kind, motion, folder / "missing" / written.name)
        if kind.read is not None:
            _check_round_trip(kind, motion, written)
            example = example or written
    if kind.read is None:
        return
    if example is None:
        raise AssertionError(f"{kind.name} is only read: give check_format an example of a sound file")
    _ensure(kind.recognise(example.read_bytes()[:HEAD]) >= 1, f"recognise is not sure of {example.name}")
    _check_finite(read_as(kind, example), example)
    for head in (b"", b"\0", b"\xff\xfe" * 40, b"[" * HEAD, b"{", bytes(HEAD)):
        try:
            kind.recognise(head)
        except Exception as error:
            raise AssertionError(f"recognise raises {type(error).__name__} for {head[:20]!r}") from error
    shutil.copytree(example.parent, folder / "damaged")
    _check_damage(kind, folder / "damaged" / example.name)


def _check_round_trip(kind: Format, motion: Motion, path: Path) -> None:
    made = read_as(kind, path)
    _ensure(len(made) == 1, f"{len(made)} motions came back of one")
    back = made[0]
    _ensure(len(back) == len(motion), f"{len(back)} frames came back of {len(motion)}")
    _ensure(abs(back.rate / motion.rate - 1) < 1e-4, f"a rate of {back.rate} came back of {motion.rate}")
    missing = set(motion.skeleton.names) - set(back.skeleton.names)
    _ensure(not missing, f"the joints {', '.join(sorted(missing))} did not come back")
    columns = [back.skeleton.index(name) for name in motion.skeleton.names]
    apart = motion_frames(back).positions[:, columns] - motion_frames(motion).positions
    far = np.linalg.norm(apart, axis=-1)
    frame, joint = divmod(int(far.argmax()), far.shape[1])
    told = f"{motion.skeleton.names[joint]} is {1e3 * far.max():.2f} mm away after writing and reading"
    _ensure(bool(far.max() < _CLOSE), f"{told}, in frame {frame}")


def _check_refuses_to_write(kind: Format, motion: Motion, path: Path) -> None:
    assert kind.write is not None
    try:
        kind.write(motion, path)
    except PoseloomError as error:
        _ensure(path.name in str(error), f"the error for a missing folder does not name the file: {error}")
    except Exception as error:
        raise AssertionError(f"writing into a missing folder raises {type(error).__name__}: {error}") from error
    else:
        raise AssertionError("writing into a missing folder raises nothing")


def _check_damage(kind: Format, path: Path) -> None:
    whole = path.read_bytes()
    draw = np.random.default_rng(0)
    harmed = {"no bytes": b"", "spaces": b" \n\n", "zeros": bytes(300), "a picture": b"\x89PNG\r\n\x1a\n" + bytes(60)}
    harmed |= {f"noise {number}": draw.bytes(400) for number in range(4)}
    for end in np.linspace(1, len(whole) - 1, _HARMS).astype(int):
        harmed[f"cut after {end} bytes"] = whole[:end]
    for at in map(int, draw.integers(0, min(len(whole), 4000), _HARMS)):
        harmed[f"byte {at} changed"] = whole[:at] + bytes([whole[at] ^ 0x15]) + whole[at + 1 :]
    for what, content in harmed.items():
        path.write_bytes(content)
        _read_or_refuse(kind, path, what, must_refuse=not content.strip(b" \n\0"))
    path.unlink()
    _read_or_refuse(kind, path, "no file", must_refuse=True)
    path.mkdir()
    _read_or_refuse(kind, path, "a folder", must_refuse=True)


def _read_or_refuse(kind: Format, path: Path, what: str, must_refuse: bool) -> None:
    try:
        made = read_as(kind, path)
    except PoseloomError as error:
        _ensure(path.name in str(error), f"{what}: the error does not name the file: {error}")
    except Exception as error:
        raise AssertionError(f"{what}: reading raises {type(error).__name__}, no PoseloomError: {error}") from error
    else:
        _ensure(not must_refuse, f"{what}: a motion is read")
        _check_finite(made, path)


def _check_finite(made: list[Motion], path: Path) -> None:
    for motion in made:
        finite = bool(np.isfinite(motion.q).all()) and 0 < motion.rate < float("inf")
        _ensure(finite, f"numbers or a rate that are not finite are read from {path.name}")


def _ensure(kept: bool, broken: str) -> None:
    if not kept:
        raise AssertionError(broken)
