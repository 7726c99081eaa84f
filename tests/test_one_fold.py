"""One chooser and one fold: the same session gives the same bits live, offline and reprocessed, whatever ran in it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from every_method import EVERY, model_of
from poseloom.calibration.calibration import Calibration, apply_calibration, write_calibration
from poseloom.cli._app import run
from poseloom.errors import MethodError
from poseloom.formats import read_motion, write_motion
from poseloom.formats.recording import read_recording, write_recording
from poseloom.formats.session_recording import read_session
from poseloom.library import build_library, open_library
from poseloom.live.contract import ResetHeading
from poseloom.live.reprocess import compare_with_session, plan_reprocessing, reprocess
from poseloom.live.session import Session
from poseloom.live.settings import LiveSettings
from poseloom.live.setup import plan_session
from poseloom.live.virtual import virtual_recording
from poseloom.methods import METHODS, InverseKinematics, MethodEntry, choose, needs_library, reconstruct
from poseloom.methods.choose import default_method, fitting_methods
from poseloom.methods.registry import Needs
from poseloom.sensors import Recording, SensorKind, layout

SAMPLES = 16


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A library, and every model as it is asked for."""
    path = tmp_path_factory.mktemp("fold")
    build_library(["samples"], path / "library", mirror=False, workers=1, exclude=("walk",))
    return path


def recorded(worn: str, rate: float | None = None) -> Recording:
    wanted = layout(worn)
    whole = virtual_recording("sample:walk", replace(wanted, rate=rate or wanted.rate), seed=4, endless=False)
    return whole.cut(10, 10 + SAMPLES)


def calibration_of(recording: Recording) -> Calibration:
    """Another body and other placements than the recording's."""
    body, none = recording.skeleton, np.zeros
    sensors, joints = len(recording.layout), len(body)
    moved = tuple(replace(p, p_bone_sensor=p.p_bone_sensor + 0.01) for p in recording.placements)
    return Calibration(
        body.with_offsets(1.05 * body.offsets, 1.05 * body.tips), recording.layout.names, moved, none(3), none(joints),
        none(joints), none((sensors, 3)), none((sensors, 3)), ("arms out",), none((1, sensors, 2)), none(1), (),
    )  # fmt: skip


def live(source: Path, folder: Path, recorded_to: Path, export: Path, **more: str) -> None:
    """A session in which no sample is passed over, however busy the machine is."""
    settings = LiveSettings(
        (f"replay://{source}?speed=20",), record=str(recorded_to), export=str(export), folder=str(folder), **more
    )
    Session(replace(plan_session(settings), capacity=10_000, patience=1e9)).run()


@pytest.mark.parametrize(("name", "worn"), EVERY)
def test_live_offline_and_reprocessed_are_the_same_bits(name: str, worn: str, folder: Path, tmp_path: Path) -> None:
    library, model = folder / "library", model_of(name, worn, folder)
    recording = recorded(worn)
    write_recording(recording, tmp_path / "source.mcap")
    write_calibration(calibration_of(recording), tmp_path / "own.npz")
    given = {"library": str(library)} if needs_library(name) else {}
    given |= {} if model is None else {"model": str(model)}
    seen = []
    for number, calibration in enumerate(("", str(tmp_path / "own.npz"))):
        path, export = tmp_path / f"{number}.mcap", tmp_path / f"{number}.bvh"
        live(tmp_path / "source.mcap", tmp_path, path, export, method=name, calibration=calibration, **given)
        session = read_session(path)
        spoke = np.isfinite(session.steps.times)
        assert spoke.sum() >= SAMPLES - 5

        again = reprocess(session, plan_reprocessing(session))
        same = compare_with_session(session, again)
        assert (same.agrees, same.compared, same.largest) == (True, spoke.sum(), 0.0)

        plain = read_recording(path)
        offline = reconstruct(choose(plain.layout, name, **given).method, plain)
        np.testing.assert_array_equal(offline.motion.q, session.steps.q[spoke])
        np.testing.assert_array_equal(offline.spread, session.steps.spread[spoke])

        wearer = calibration_of(recording).skeleton if calibration else recording.skeleton
        np.testing.assert_array_equal(plain.skeleton.offsets, wearer.offsets)
        write_motion(again.even(), tmp_path / "again.bvh")
        assert (tmp_path / "again.bvh").read_bytes() == export.read_bytes()
        seen.append(session.steps.q[spoke])
    assert run(["reconstruct", str(path), "--check", "-o", str(tmp_path / "cli.bvh")]) == 0
    assert (tmp_path / "cli.bvh").read_bytes() == export.read_bytes()
    if SensorKind.FLEX is not METHODS[name].sensors:  # angles of flex sensors do not depend on the body
        assert not np.array_equal(seen[0], seen[1])


def test_a_recording_of_another_rate_gives_the_same_live_and_offline(folder: Path, tmp_path: Path) -> None:
    recording = recorded("six-trackers", 60.0)
    write_recording(recording, tmp_path / "60.mcap")
    given = {"method": "local-filter", "library": str(folder / "library")}
    live(tmp_path / "60.mcap", tmp_path, tmp_path / "s.mcap", tmp_path / "live.bvh", **given)
    session = read_session(tmp_path / "s.mcap")
    assert session.recording.layout.rate == 40.0
    chosen = choose(recording.layout, "local-filter", library=folder / "library")
    offline = reconstruct(chosen.method, recording)
    assert offline.motion.rate == 40.0
    assert "60 samples a second" in offline.notes[0]
    np.testing.assert_array_equal(offline.motion.q, session.steps.q)


def test_a_session_is_reprocessed_with_a_library_of_another_rate(folder: Path, tmp_path: Path) -> None:
    """With a heading reset on the way, which stays where it was."""
    write_recording(virtual_recording("sample:walk", replace(layout("six-trackers"), rate=60.0), endless=False),
                    tmp_path / "60.mcap")  # fmt: skip
    plan = plan_session(LiveSettings((f"replay://{tmp_path}/60.mcap?speed=4",), record=str(tmp_path / "s.mcap")))
    session = Session(replace(plan, capacity=10_000, patience=1e9))

    class Resets:
        name, capacity, count = "resets", 10_000, 0

        def open(self, facts, post):
            self.post = post

        def changed(self, facts): ...

        def show(self, update):
            self.count += 1
            if self.count == 30:
                self.post(ResetHeading())

        def close(self): ...

    session.__init__(replace(session.plan, sinks=(Resets(),)))
    session.run()
    read = read_session(tmp_path / "s.mcap")
    assert len(read.starts) == 2
    how = plan_reprocessing(read, "local-filter", folder / "library")
    assert "not local-filter" in how.differences[0]
    again = reprocess(read, how)
    assert again.motion.rate == 40.0
    after = float(read.recording.times[read.starts[1].sample])
    row, own = int(np.searchsorted(again.times, after)), int(np.searchsorted(read.steps.samples, read.starts[1].sample))
    # The hips leap to where the session put them, however long the reset took on a busy machine.
    assert np.abs(again.motion.q[row, :3] - read.steps.q[own, :3]).max() < 0.1
    assert np.abs(again.motion.q[row, [0, 2]] - again.motion.q[row - 1, [0, 2]]).max() > 0.2
    given = ["-m", "local-filter", "-l", str(folder / "library")]
    assert run(["reconstruct", str(tmp_path / "s.mcap"), "--check", *given]) == 1


def test_check_is_for_sessions_only(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_recording(recorded("six-trackers"), tmp_path / "a.mcap")
    assert run(["reconstruct", str(tmp_path / "a.mcap"), "--check"]) == 2
    assert "holds no session's poses" in capsys.readouterr().err
    assert run(["reconstruct", str(tmp_path / "a.mcap")]) == 2
    assert "no output was given" in capsys.readouterr().err


# --- the chooser -----------------------------------------------------------------------------------------------------


def test_objects_stand_wherever_names_do(folder: Path) -> None:
    worn = layout("six-trackers")
    library = open_library(folder / "library")
    own = InverseKinematics(worn)
    assert choose(worn, own).method is own
    assert choose(worn, own).name == "InverseKinematics"
    by_object, by_path = (choose(worn, "local-pcr", library=each) for each in (library, str(folder / "library")))
    assert by_object.library is library
    assert by_path.method.layout == by_object.method.layout
    assert choose(worn, library=library).name == "local-filter"
    assert choose(worn).name == "inverse-kinematics"
    assert choose(layout("flex-four")).name == "flex-scales"
    assert choose(replace(worn, rate=72.0), library=library).method.layout.rate == 40.0
    assert choose(replace(worn, rate=72.0)).method.layout.rate == 72.0


def test_a_model_says_which_method_runs_it(folder: Path) -> None:
    for name, worn in (
        ("phase-hmm", "right-foot-imu"),
        ("nearest-window", "right-foot-imu"),
        ("flex-lstm", "flex-four"),
    ):
        file = model_of(name, worn, folder)
        assert default_method(layout(worn), model=file) == name
        assert choose(layout(worn), model=file).model == file


def test_what_does_not_fit_is_refused(folder: Path) -> None:
    imu = layout("right-foot-imu")
    with pytest.raises(MethodError, match="for tracker sensors"):
        choose(imu, "local-filter", library=folder / "library")
    with pytest.raises(MethodError, match="no method was given"):
        choose(imu)
    with pytest.raises(MethodError, match="Did you mean 'local-filter'"):
        choose(layout("six-trackers"), "local-filtre")
    with pytest.raises(MethodError, match="listens to"):
        choose(layout("left-foot-imu"), "phase-hmm", model=model_of("phase-hmm", "right-foot-imu", folder))
    with pytest.raises(MethodError, match="listens to"):
        choose(layout("three-trackers"), InverseKinematics(layout("six-trackers")))
    assert set(fitting_methods(layout("flex-four"))) == {"flex-scales", "flex-lstm", "sensor-prior"}
    assert default_method(layout("flex-four")) == "flex-scales"
    assert default_method(layout("six-imus")) == "sensor-prior"
    assert fitting_methods(layout("six-trackers"))[0] == "local-filter"


def test_an_incomplete_entry_is_an_error_when_it_is_made() -> None:
    """Never another method in its place."""
    whole = METHODS["inverse-kinematics"]
    for lack in ({"make": None}, {"needs": "much"}, {"sensors": "ears"}, {"summary": ""}, {"shipped": Path("x")}):
        with pytest.raises(TypeError):
            replace(whole, **lack)
    with pytest.raises(TypeError):
        MethodEntry("a method", SensorKind.IMU, Needs.MODEL)  # pyright: ignore[reportCallIssue]


def test_a_calibration_that_is_named_replaces_the_sessions_own(folder: Path, tmp_path: Path) -> None:
    recording = recorded("six-trackers")
    write_recording(recording, tmp_path / "a.mcap")
    other = calibration_of(recording)
    write_calibration(other, tmp_path / "c.npz")
    files = {suffix: str(tmp_path / f"a{suffix}") for suffix in (".mcap", ".npz")}
    assert run(["reconstruct", files[".mcap"], "-c", str(tmp_path / "c.npz"), "-o", files[".npz"]]) == 0
    expected = reconstruct(choose(recording.layout).method, apply_calibration(recording, other))
    np.testing.assert_array_equal(read_motion(tmp_path / "a.npz").q, expected.motion.q)
