"""Damages small files of every kind and reads them; run by `test_hostile_files`, one line a trial.

In a process of its own, for what it looks for is also a crash, a hang, and memory that does not end: the last line that
it printed names kind and trial. Each trial has its own fixed seed.
"""

import json
import re
import resource
import signal
import struct
import sys
import traceback
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import scipy.io

from poseloom.errors import PoseloomError
from poseloom.formats.bend_tables import read_bend_tables, read_displaced_tables
from poseloom.formats.column_map import read_column_map
from poseloom.formats.flex_log import read_flex_log
from poseloom.formats.glb_reading import read_glb
from poseloom.formats.imus import assemble_imus, read_imu_tracks
from poseloom.formats.motions import is_motion_file, read_motions, write_motion
from poseloom.formats.recording import read_recording, write_recording
from poseloom.formats.session_recording import read_session
from poseloom.formats.tracker_tables import read_tracker_table
from poseloom.samples import sample_motions
from poseloom.sensors import layout
from poseloom.skeleton.resample import resample
from poseloom.synthesis import simulate_imus

SECONDS = 10
"""Of this process's own time that one reading may take."""
ROOM = 1 << 30
"""Bytes that one reading may take beyond what the process has when it begins."""
NUMBERS = (
    "1e400 -1e308 1e15 1e-320 nan -inf 0 -1 1e7 99999999999 2147483648 0x10 1_0 ,, 1e 1,5 -0.0 9e99 "
    + "9" * 5000 + " " + "1" * 200_000
).split(" ")  # fmt: skip
NESTS = (b"[", b"{", b'{"a":', b"<a>", b"(", b'"', b"JOINT x {\n", b"begin\n", b"a.")


@dataclass(frozen=True)
class Kind:
    """Files that belong together, which of them are damaged, and what reads them."""

    files: dict[str, bytes]
    damaged: tuple[str, ...]
    read: Callable[[Path], object]


def bvh() -> bytes:
    lines = ["HIERARCHY", "ROOT Hips", "{", "OFFSET 0 0 0"]
    lines += ["CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation", "JOINT Left Leg", "{"]
    lines += ["OFFSET 0 -45.5 0", "CHANNELS 3 Zrotation Xrotation Yrotation", "End Site", "{", "OFFSET 0 -40 0", "}"]
    lines += ["}", "}", "MOTION", "Frames: 4", "Frame Time: 0.0333333"]
    lines += [f"{0.1 * i} 90 1e-1 {i} 2 -3 4 5.25 {-i}" for i in range(4)]
    return ("\n".join(lines) + "\n").encode()


ASF = b""":version 1.10
:units
  mass 1.0
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
    axis 10 -20 30 XYZ
    dof rx ry rz
    limits (-160.0 20.0)
           (-70.0 70.0)
           (-60.0 70.0)
  end
  begin
    id 2
    name shank
    direction 0 -1 0
    length 8
    axis 15 90 -30 ZXY
    dof rz
  end
:hierarchy
  begin
    root thigh
    thigh shank
  end
"""


def amc() -> bytes:
    frames = [f"{i}\nroot 1 {i} 3 10 20 30\nthigh 5 6 7e0\nshank -4{i}" for i in range(1, 5)]
    return ("\n".join([":FULLY-SPECIFIED", ":DEGREES", *frames]) + "\n").encode()


def expmap() -> dict[str, bytes]:
    joints = [("hips", None), ("leg", "hips"), ("leg_end", "leg")]
    content = {
        "joints": [{"name": name, "parent": parent, "offset": [0, -0.5, 0]} for name, parent in joints],
        "metres_per_unit": 1.0,
        "frame_rate_hz": 30.0,
        "up_axis": "y",
    }
    rows = [",".join(f"{0.01 * i + 0.1 * j:.4f}" for j in range(12)) for i in range(5)]
    return {"a.csv": ("\n".join(rows) + "\n").encode(), "skeleton.json": json.dumps(content).encode()}


def deepmimic() -> bytes:
    quats = [1.0, 0.0, 0.0, 0.0]
    turns = [quats if n == 4 else [0.1] * n for n in (4, 4, 4, 4, 1, 4, 4, 1, 4, 1, 4, 4, 1)]
    frame = [0.0333333, 0.0, 0.9, 0.0] + [value for turn in turns for value in turn]
    return json.dumps({"Loop": "wrap", "Frames": [frame[:44] for _ in range(4)]}).encode()


def xsens() -> bytes:
    head = (
        "// Update Rate: 100.0Hz\nPacketCounter,Acc_X,Acc_Y,Acc_Z,Gyr_X,Gyr_Y,Gyr_Z,Quat_q0,Quat_q1,Quat_q2,Quat_q3\n"
    )
    return (head + "".join(f"{i + 65530},9.80665,0,{i % 3},0.1,0.2,0.3,0.7,0,0.7,0\n" for i in range(12))).encode()


def mvnx() -> bytes:
    frames = "".join(
        f'<frame time="{16 * i}" index="{i}" type="normal"><sensorFreeAcceleration>0 0 1 1 0 0</sensorFreeAcceleration>'
        "<sensorOrientation>1 0 0 0 0.7 0 0.7 0</sensorOrientation></frame>\n"
        for i in range(8)
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<mvnx xmlns="http://www.xsens.com/mvn/mvnx"><subject frameRate="60">'
        '<sensors><sensor label="Pelvis"/><sensor label="RightHand"/></sensors><frames><frame time="0" type="tpose">'
        f"</frame>{frames}</frames></subject></mvnx>"
    ).encode()


def sto() -> bytes:
    rows = "".join(f"{i * 0.01:.2f}\t1,0,0,0\t0.7,0.1,0.7,{0.01 * i:.2f}\n" for i in range(10))
    return f"DataRate=100\nDataType=Quaternion\nversion=3\nendheader\ntime\ta\tb\n{rows}".encode()


def xio() -> dict[str, bytes]:
    axes = ",".join([f"Gyroscope {axis} (deg/s)" for axis in "XYZ"] + [f"Accelerometer {axis} (g)" for axis in "XYZ"])
    rows = "".join(f"{917410905 + 20035 * i},18{i},0,0,1,0,0\n" for i in range(10))
    turned = "".join(f"{917410905 + 20035 * i},1,0,0,0\n" for i in range(10))
    return {
        "Foot 64F619FB (UDP)/Inertial.csv": f"Timestamp (us),{axes}\n{rows}".encode(),
        "Foot 64F619FB (UDP)/Quaternion.csv": f"Timestamp (us),W,X,Y,Z\n{turned}".encode(),
    }


def imu_table() -> bytes:
    swing = np.sin(np.arange(30) / 4)
    rows = "".join(f"{i * 10},{0.1 * s:.4f},9.81,{s:.4f},{s:.4f},{-s:.4f},0.01\n" for i, s in enumerate(swing))
    return f"time (ms),acc_x,acc_y,acc_z,gyr_x (rad/s),gyr_y (rad/s),gyr_z (rad/s)\n{rows}".encode()


def matlab(folder: Path) -> bytes:
    sensor = {"acc": np.tile([0.0, 0.0, 9.81], (8, 1)), "gyr": np.full((8, 3), 0.1)}
    scipy.io.savemat(folder / "a.mat", {"t": np.arange(8) / 100, "foot": sensor}, do_compression=True)
    return (folder / "a.mat").read_bytes()


def flex() -> bytes:
    return ("time_ms,A0,A1,A2,A3\n" + "".join(f"{i * 50},{500 + i},510,{600 - i},620\n" for i in range(40))).encode()


def bend() -> dict[str, bytes]:
    rows = "".join(f"{500 + i % 90},{600 - i % 80},{180 - i % 90}\n" for i in range(520))
    shifted = "".join(f"{500 + i},{600 - i},{180 - i},{10 * (i % 2)},{i % 3}\n" for i in range(12))
    return {
        "P_1.csv": f"r1,r2,angle\n{rows}".encode(),
        "displacement.csv": f"r1,r2,angle,circular,lateral\n{shifted}".encode(),
    }


def trackers() -> bytes:
    names = ("head", "leftHand", "rightHand")
    head = ",".join(["time", *(f"{name}_{part}" for name in names for part in ("x", "y", "z", "qw", "qx", "qy", "qz"))])
    rows = "".join(
        f"{0.02 * i:.2f},0,1.7,{0.01 * i:.2f},1,0,0,0,0.4,1.{i % 10},0,1,0,0,0,-0.4,1,0.1,0.7,0,0.7,0\n"
        for i in range(30)
    )
    return f"{head}\n{rows}".encode()


MAP = b"""rate = 100
time = "t"
accel_unit = "g"
[sensors.foot]
acceleration = ["ax", "ay", "az"]
angular_rate = ["gx", "gy", "gz"]
"""


def kinds(folder: Path) -> dict[str, Kind]:
    walk = sample_motions()["walk"].cut(0, 30)
    foot = layout("right-foot-imu")
    write_motion(walk.cut(0, 5), folder / "a.npz")
    write_motion(walk.cut(0, 5), folder / "a.glb")
    write_recording(simulate_imus(resample(walk, foot.rate), foot, seed=1), folder / "a.mcap")
    whole = {name: (folder / name).read_bytes() for name in ("a.npz", "a.glb", "a.mcap")}

    def alone(name: str, content: bytes, read: Callable[[Path], object]) -> Kind:
        return Kind({name: content}, (name,), lambda out: read(out / name))

    def imus(out: Path) -> None:
        tracks = list(read_imu_tracks(out).values()) if out.is_dir() else list(read_imu_tracks([out]).values())
        assemble_imus(dict(zip(("right-foot", "left-foot"), tracks, strict=False)))

    def motion(path: Path) -> None:
        is_motion_file(path)
        for found in read_motions(path):
            assert np.isfinite(found.q).all(), "a pose is not finite"
            resample(found, 40.0)

    def log(path: Path) -> None:
        for rate in (None, 20.0):
            recording, _ = read_flex_log(path, layout("flex-four"), rate=rate)
            assert np.isfinite(recording.times).all(), "a time is not finite"

    exp, folders, bent = expmap(), xio(), bend()
    return {
        "bvh": alone("a.bvh", bvh(), motion),
        "amc": Kind({"a.amc": amc(), "a.asf": ASF}, ("a.amc", "a.asf"), lambda out: motion(out / "a.amc")),
        "expmap": Kind(exp, tuple(exp), lambda out: motion(out / "a.csv")),
        "deepmimic": alone("a.txt", deepmimic(), motion),
        "glb": alone("a.glb", whole["a.glb"], read_glb),
        "npz": alone("a.npz", whole["a.npz"], motion),
        "recording": alone("a.mcap", whole["a.mcap"], read_recording),
        "session": alone("a.mcap", whole["a.mcap"], read_session),
        "mvnx": alone("a.mvnx", mvnx(), imus),
        "sto": alone("a.sto", sto(), imus),
        "xsens": alone("a.txt", xsens(), imus),
        "matlab": alone("a.mat", matlab(folder), imus),
        "imu-table": alone("a.csv", imu_table(), imus),
        "xio": Kind(folders, tuple(folders), lambda out: imus(out / "Foot 64F619FB (UDP)")),
        "flex-log": alone("a.csv", flex(), log),
        "bend-tables": Kind(bent, ("P_1.csv",), read_bend_tables),
        "shifted-tables": Kind(bent, ("displacement.csv",), read_displaced_tables),
        "trackers": alone("a.csv", trackers(), read_tracker_table),
        "column-map": alone("a.toml", MAP, read_column_map),
    }


def huge_number(content: bytes, rng: np.random.Generator) -> bytes:
    """Text in which one number became another."""
    found = list(re.finditer(rb"-?\d+(\.\d+)?(e-?\d+)?", content))
    if not found:
        return content
    at = found[int(rng.integers(len(found)))]
    return content[: at.start()] + NUMBERS[int(rng.integers(len(NUMBERS)))].encode() + content[at.end() :]


def mutated(content: bytes, others: list[bytes], rng: np.random.Generator) -> bytes:
    what = int(rng.integers(9))
    at, to = sorted(int(i) for i in rng.integers(len(content) + 1, size=2))
    if what == 0:
        out = bytearray(content)
        for place in rng.integers(len(out), size=int(rng.integers(1, 20))):
            out[place] ^= int(rng.integers(1, 256))
        return bytes(out)
    if what == 1:
        return content[:at]
    if what == 2:
        other = others[int(rng.integers(len(others)))]
        begin, end = sorted(int(i) for i in rng.integers(len(other) + 1, size=2))
        return content[:at] + other[begin:end] + content[to:]
    if what == 3:
        return content[:to] + content[at:to] * int(rng.integers(1, 4)) + content[to:]
    if what == 4:
        lines = content.splitlines(keepends=True)
        del lines[int(rng.integers(len(lines)))]
        return b"".join(lines)
    if what == 5:
        nest = NESTS[int(rng.integers(len(NESTS)))]
        return content[:at] + nest * int(10 ** rng.uniform(1, 4.5)) + content[at:]
    if what == 6:
        signs = [b",", b";", b"\t", b" ", b".", b"\n", b"\r\n", b"\0", b"{", b"}", b'"', b"\xff"]
        one, two = (signs[int(i)] for i in rng.integers(len(signs), size=2))
        return content.replace(one, two)
    return huge_number(content, rng)


def mutated_glb(content: bytes, rng: np.random.Generator) -> bytes:
    """A GLB whose description was changed and whose lengths are right: whoever crafts one does that too."""
    (length,) = struct.unpack_from("<I", content, 12)
    text = mutated(content[20 : 20 + length], [content], rng)
    text += b" " * (-len(text) % 4)
    rest = content[20 + length :]
    head = struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text) + len(rest), len(text), b"JSON")
    return head + text + rest


class HangError(BaseException):
    """No reader may catch it."""


def too_long(*_: object) -> None:
    raise HangError(f"more than {SECONDS} s")


def complaint(error: BaseException, folder: Path) -> str:
    """What is wrong with the way in which a reading ended; nothing for an error that names the file."""
    if not isinstance(error, PoseloomError):
        return "".join(traceback.format_exception(error)[-3:])
    if isinstance(error.__cause__, MemoryError) or isinstance(error.__context__, MemoryError):
        return f"memory: {error}"
    return "" if error.file and str(folder) in error.file else f"names no file: {error}"


def main(folder: Path, count: int, only: str = "") -> None:
    warnings.simplefilter("ignore")
    signal.signal(signal.SIGPROF, too_long)
    known = {name: kind for name, kind in kinds(folder).items() if only in name}
    others = [content for kind in kinds(folder).values() for content in kind.files.values()]
    for name, kind in known.items():
        out = folder / name
        for part, content in kind.files.items():
            (out / part).parent.mkdir(parents=True, exist_ok=True)
            (out / part).write_bytes(content)
        kind.read(out)  # what is not damaged is read
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit = pages * resource.getpagesize() + ROOM
    resource.setrlimit(resource.RLIMIT_AS, (limit, resource.getrlimit(resource.RLIMIT_AS)[1]))
    escaped = 0
    for name, kind in known.items():
        out = folder / name
        for trial in range(count):
            print(name, trial, flush=True)
            rng = np.random.default_rng([trial, *name.encode()])
            part = kind.damaged[int(rng.integers(len(kind.damaged)))]
            damage = mutated_glb if name == "glb" and trial % 2 else partial(mutated, others=others)
            (out / part).write_bytes(damage(kind.files[part], rng=rng))
            signal.setitimer(signal.ITIMER_PROF, SECONDS)
            try:
                kind.read(out)
            except BaseException as error:
                wrong = complaint(error, folder)
                escaped += bool(wrong)
                if wrong:
                    print(f"ESCAPED {name} {trial}: {wrong[-1500:]!r}", flush=True)
            finally:
                signal.setitimer(signal.ITIMER_PROF, 0)
            (out / part).write_bytes(kind.files[part])
    print("escaped", escaped)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), *sys.argv[3:])
