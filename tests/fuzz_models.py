"""Damages every kind of fitted file and uses what can still be read; run by `test_hostile_models`, one line a trial.

In a process of its own, for what it looks for is a crash: the last line that it printed names kind and trial.
"""

import io
import json
import shutil
import sys
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from poseloom.calibration.calibration import read_calibration
from poseloom.errors import PoseloomError
from poseloom.formats import session_recording
from poseloom.formats.npz import read_npz
from poseloom.formats.recording import read_recording
from poseloom.formats.recording_header import RecordingHeader
from poseloom.formats.session_recording import MethodStart, RecordedFinding, SessionWriter, read_session
from poseloom.library import open_library, store
from poseloom.library.build import six_trackers
from poseloom.live.reprocess import recorded_motion
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


def search_library(path: Path) -> None:
    library = open_library(path)
    for clip in library.clips[:2]:
        library.motion(clip)
    index = library.moments(six_trackers())
    found = index.search(index.columns[0].astype(np.float64), 3)
    assert all(np.isfinite(part).all() for part in found), "what was found is not finite"


def damaged_library(folder: Path, rng: np.random.Generator) -> None:
    """A library with one file changed and all its digests made right again: whoever crafts one does that too."""
    generation = folder / "generation-1"
    (moments,) = (path for path in generation.iterdir() if path.is_dir())
    files = [*generation.glob("poses.npy"), *generation.glob("*.sqlite"), *moments.glob("*.npy")]
    path = sorted(files)[int(rng.integers(len(files)))]
    whole = path.read_bytes()
    changed = weird_array(whole, rng) if path.suffix == ".npy" and rng.random() < 0.8 else damaged(whole, None, rng)
    path.write_bytes(changed)
    header = store.read_header(folder)
    store.write_seal(moments)
    store.write_header(folder, store.with_generation(header, generation))


def session_parts(recording: Any) -> list[tuple[str, bytes]]:
    """Topics and messages of a method's starts, findings and steps, as a session writes them."""
    dofs, sensors = recording.skeleton.size, len(recording.layout)
    starts = [json.dumps(vars(MethodStart(0, "phase-hmm"))).encode()]
    findings = [json.dumps(vars(RecordedFinding(3, 0.1, "rightFoot", "silent", "began"))).encode()]
    step = np.zeros((), dtype=session_recording._step_type(dofs, sensors))
    return [
        *((session_recording.STARTS_TOPIC, each) for each in starts),
        *((session_recording.FINDINGS_TOPIC, each) for each in findings),
        *((session_recording.STEPS_TOPIC, step.tobytes()) for _ in range(4)),
    ]


def damaged_message(topic: str, content: bytes, rng: np.random.Generator) -> bytes:
    plain = topic != session_recording.STEPS_TOPIC and rng.random() < 0.7
    changed = weird_json(content, rng) if plain else damaged(content, None, rng)
    if topic == session_recording.STEPS_TOPIC and rng.random() < 0.5:
        words = np.frombuffer(content[: len(content) // 8 * 8], "<i8").copy()
        words[rng.integers(min(len(words), 6))] = [-1, 2**62, 0x7FF8 << 48, 0x7FF0 << 48, 5][int(rng.integers(5))]
        changed = words.tobytes() + content[len(words) * 8 :]
    return changed


def write_damaged_session(path: Path, recording: Any, rng: np.random.Generator | None) -> None:
    """A whole recording of a session in which one message of the method's is damaged, where there is chance."""
    parts = session_parts(recording)
    if rng is not None:
        at = int(rng.integers(len(parts)))
        parts[at] = (parts[at][0], damaged_message(*parts[at], rng))
    path.unlink(missing_ok=True)
    header = RecordingHeader(recording.layout, recording.placements, recording.skeleton, recording.name, {}, None, "")
    with SessionWriter(path, header) as writer:
        for index in range(10):
            writer.write_sample(recording.sample(index))
        for topic, content in parts:
            writer._add(topic, 0.1, content)


def use_session(path: Path) -> None:
    session = read_session(path)
    recorded_motion(session)


def others(folder: Path, count: int, recording: Any) -> int:
    """Trials of libraries' arrays and sessions' topics; how many escaped."""
    escaped = 0
    search_library(folder / "library")  # what is not damaged is read
    write_damaged_session(folder / "sound-session.mcap", recording, None)
    use_session(folder / "sound-session.mcap")
    for trial in range(count):
        for kind in ("library arrays", "session topics"):
            print(kind, trial, flush=True)
            rng = np.random.default_rng([trial, *kind.encode()])
            try:
                if kind == "library arrays":
                    target = folder / "damaged-library"
                    shutil.rmtree(target, ignore_errors=True)
                    shutil.copytree(folder / "library", target)
                    damaged_library(target, rng)
                    search_library(target)
                else:
                    write_damaged_session(folder / "damaged-session.mcap", recording, rng)
                    use_session(folder / "damaged-session.mcap")
            except PoseloomError:
                pass
            except BaseException as error:
                escaped += 1
                print(f"ESCAPED {kind} {trial}: {type(error).__name__}: {str(error)[:200]}", flush=True)
    return escaped


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
    print("escaped", escaped + others(folder, count // 2, worn["imu"]))


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
