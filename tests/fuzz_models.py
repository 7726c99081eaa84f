"""Damages every kind of fitted file and uses what can still be read; run by `test_hostile_models`, one line a trial.

In a process of its own, for what it looks for is a crash: the last line that it printed names kind and trial.
"""

import io
import json
import sys
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from poseloom.calibration.calibration import read_calibration
from poseloom.errors import PoseloomError
from poseloom.formats.npz import read_npz
from poseloom.formats.recording import read_recording
from poseloom.library import open_library, store
from poseloom.methods import make_method

WEIRD = (None, -1, 0, 1, 2**31, 2**63, 1e308, float("nan"), "", "x" * 300, [], {}, True, "../victim", [[]])


def parts_of(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def weird_json(text: bytes, rng: np.random.Generator) -> bytes:
    """JSON in which one entry became another, or went."""
    content = json.loads(text)
    at, way = content, []
    while isinstance(at, dict | list) and len(at) and (not way or rng.random() < 0.8):
        keys = list(at) if isinstance(at, dict) else range(len(at))
        way.append((at, keys[int(rng.integers(len(keys)))]))
        at = at[way[-1][1]]
    holder, key = way[-1]
    if rng.random() < 0.15:
        del holder[key]
    else:
        holder[key] = WEIRD[int(rng.integers(len(WEIRD)))]
    return json.dumps(content).encode()


def weird_array(content: bytes, rng: np.random.Generator) -> bytes:
    """An array of another type, shape or content."""
    array = np.load(io.BytesIO(content))
    what = int(rng.integers(8))
    if what == 0:
        array = array.astype([np.float64, np.float32, np.int64, np.int32, ">f8", np.bool_, "U3"][int(rng.integers(7))])
    elif what == 1:
        array = array[: int(rng.integers(len(array) + 1))] if array.ndim else array
    elif what == 2:
        array = array.reshape(-1) if rng.random() < 0.5 else array[None]
    elif what == 3:
        array = np.concatenate([array, array]) if array.ndim else array
    elif array.size and array.dtype != np.bool_:
        flat = array.reshape(-1).copy()
        count = 1 if rng.random() < 0.7 else flat.size
        value = [-1, 0, 10**6, 2**40, -(2**40), np.nan, np.inf, 1e30][int(rng.integers(8))]
        if np.isfinite(value) or flat.dtype.kind == "f":
            with np.errstate(all="ignore"):
                flat[rng.integers(flat.size, size=count)] = np.array(value).astype(flat.dtype)
        array = flat.reshape(array.shape)
    out = io.BytesIO()
    np.save(out, array)
    return out.getvalue()


def damaged(whole: bytes, parts: dict[str, bytes] | None, rng: np.random.Generator) -> bytes:
    what = rng.random()
    if parts is not None and what < 0.6:
        changed = dict(parts)
        name = list(parts)[int(rng.integers(len(parts)))] if rng.random() < 0.6 else "header.json"
        changed[name] = (weird_json if name.endswith(".json") else weird_array)(parts[name], rng)
        out = io.BytesIO()
        with zipfile.ZipFile(out, "w") as archive:
            for each, content in changed.items():
                archive.writestr(each, content)
        return out.getvalue()
    if what < 0.8:
        return whole[: int(rng.integers(len(whole)))]
    content = bytearray(whole)
    for at in rng.integers(len(content), size=int(rng.integers(1, 20))):
        content[at] ^= int(rng.integers(1, 256))
    return bytes(content)


def run_method(name: str, recording: Any) -> Callable[[Path], object]:
    def use(path: Path) -> None:
        method = make_method(name, recording.layout, model=path)
        if method.layout.names != recording.layout.names:
            return
        state = method.start(recording.skeleton, recording.placements)
        for index in range(6):
            state, frame = method.step(state, recording.sample(index))
            assert frame is None or np.isfinite(frame.pose.q).all(), "a pose is not finite"

    return use


def use_library(path: Path) -> None:
    library = open_library(path.parent)
    for clip in library.clips[:3]:
        library.motion(clip)


def damaged_header(text: bytes, rng: np.random.Generator) -> bytes:
    """A library's header with one entry changed, and the digest made right again: whoever crafts one does that too."""
    fields = json.loads(weird_json(text, rng))
    if isinstance(fields, dict):
        fields.pop("digest", None)
        fields["digest"] = store._digest(fields)
    return json.dumps(fields).encode()


def main(folder: Path, count: int) -> None:
    warnings.simplefilter("ignore")
    worn = {name: read_recording(folder / f"{name}.mcap") for name in ("imu", "flex")}
    comparators = ("nearest-window", "sparse-accelerometers", "motion-graph", "motion-primitives", "phase-regression")
    uses: dict[str, Callable[[Path], object]] = {
        "phase-hmm.npz": run_method("phase-hmm", worn["imu"]),
        **{f"{name}.npz": run_method(name, worn["imu"]) for name in comparators},
        "flex-scales.npz": run_method("flex-scales", worn["flex"]),
        "calibration.npz": read_calibration,
        "motion.npz": read_npz,
        "imu.mcap": read_recording,
        "library/library.json": use_library,
    }
    escaped = 0
    for kind, use in uses.items():
        path = folder / kind
        if not path.exists():
            continue
        whole = path.read_bytes()
        parts = parts_of(path) if kind.endswith(".npz") else None
        # The comparators share one reader, and the slow ones fit themselves anew each time.
        slow = kind.removesuffix(".npz") in (*comparators[1:], "flex-scales")
        trials = count // 10 if slow else count
        for trial in range(trials):
            print(kind, trial, flush=True)
            rng = np.random.default_rng([trial, *kind.encode()])
            header = kind.endswith(".json") and trial % 2
            target = path if kind.endswith(".json") else path.with_name(f"damaged-{path.name}")
            target.write_bytes(damaged_header(whole, rng) if header else damaged(whole, parts, rng))
            try:
                use(target)
            except PoseloomError:
                pass
            except BaseException as error:
                escaped += 1
                print(f"ESCAPED {kind} {trial}: {type(error).__name__}: {str(error)[:200]}", flush=True)
        path.write_bytes(whole)
    print("escaped", escaped)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
