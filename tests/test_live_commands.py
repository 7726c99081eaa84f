"""`poseloom live`, `reconstruct`, `simulate-device` and the benchmark's page, as users run them."""

import csv
from pathlib import Path

import numpy as np
import pytest

from poseloom.benchmark.live import hostile_inputs
from poseloom.benchmark.live.fuzzing import measure_parsers
from poseloom.benchmark.live.notebook import Notebook
from poseloom.benchmark.live.page import live_figures
from poseloom.benchmark.live.run import with_rows_of
from poseloom.cli._app import run
from poseloom.evaluation.rows import Results, Row
from poseloom.formats import read_motion, write_motion
from poseloom.formats.pose_table import write_pose_table
from poseloom.live.contract import Counters, Latency, SessionFacts, Update
from poseloom.methods import Frame, Health
from poseloom.samples import sample_motions
from poseloom.sensors import Sample, layout
from poseloom.skeleton import Pose, average_body
from poseloom.skeleton.kinematics import motion_frames


def test_live_then_reconstruct(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    write_motion(sample_motions()["walk"].cut(0, 60), tmp_path / "walk.bvh")
    (tmp_path / "live.toml").write_text(
        f'source = "simulate://{tmp_path}/walk.bvh?once=1&fault=silent:leftHand:0.3:0.8"\n'
        f'record = "{tmp_path}/a.mcap"\nexport = "{tmp_path}/no.bvh"\n'
    )
    assert run(["live", "--config", str(tmp_path / "live.toml"), "--export", str(tmp_path / "a.csv")]) == 0
    told = capsys.readouterr().out
    assert "inverse-kinematics on six-trackers at 60 Hz" in told
    assert "arrival to pose sent" in told
    assert not (tmp_path / "no.bvh").exists()
    with (tmp_path / "a.csv").open() as file:
        heads, *rows = csv.reader(file)
    assert heads[:4] == ["time", "hips.x", "hips.y", "hips.z"]
    assert len(rows) >= 30
    assert run(["reconstruct", str(tmp_path / "a.mcap"), "--check", "-o", str(tmp_path / "b.npz")]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "0 without counterpart, largest difference 0" in told
    assert read_motion(tmp_path / "b.npz").rate == 60.0


def test_mistakes_are_told_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    for arguments, message in (
        (["live"], "no source was given"),
        (["live", "-s", "vmc://:39539", "--calibration", str(tmp_path / "none")], "there is no such file"),
        (["live", "--config", str(tmp_path / "none")], "there is no such file"),
        (["reconstruct", str(tmp_path / "none"), "-o", str(tmp_path / "a.bvh")], "there is no such file"),
        (["reconstruct", str(tmp_path / "none"), "-o", str(tmp_path / "a.fbx")], "no motion can be exported as .fbx"),
        (["simulate-device", "midi://:1"], "unknown scheme of a simulated device 'midi'"),
        (["simulate-device", "vmc"], "Write vmc://:39539"),
        (["simulate-device", "vmc://nowhere", "sample:walk"], "has no port"),
        (["live", "-s", "vmc:39539"], "Write vmc://:39539"),
        (["live", "-s", "vmc://:39539", "--send", "vmc:127.0.0.1:39540"], "Write vmc://127.0.0.1:39540"),
    ):
        assert run(arguments) == 2
        assert message in capsys.readouterr().err


def test_a_pose_table_holds_places_and_rotations(tmp_path: Path):
    motion = sample_motions()["kick"].cut(0, 20)
    write_pose_table(motion, tmp_path / "a.csv")
    table = np.loadtxt(tmp_path / "a.csv", delimiter=",", skiprows=1)
    assert np.allclose(table[:, 0], np.arange(20) / 60, atol=1e-6)
    cells = table[:, 1:].reshape(20, -1, 6)
    assert np.allclose(cells[..., :3], motion_frames(motion).positions, atol=1e-6)
    assert np.allclose(cells[..., 3:], motion.rotvecs, atol=1e-6)


def test_nothing_escapes_the_benchmarks_hostile_inputs():
    rows = measure_parsers(800, 1, lambda what, done, total: None)
    tried = {(row.method, row.setting): row.value for row in rows if row.metric == "tried"}
    assert {method for method, _ in tried} == {"vmc", "udp, JSON", "udp, binary", "serial"}
    assert min(tried.values()) >= 5
    assert [row for row in rows if row.metric == "escapes" and row.value] == []
    beside = [row for row in rows if row.setting.endswith("beside sound ones") and row.metric == "understood"]
    assert len(beside) > 15
    assert all(row.value == tried[row.method, row.setting] for row in beside)
    assert "Escapes: 0 (met)" in live_figures(Results("live", "d", tuple(rows)), "abc")


def test_a_lost_sound_device_is_an_escape(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(hostile_inputs, "parse_devices", lambda data: ())
    rows = measure_parsers(400, 1, lambda what, done, total: None)
    assert sum(row.value for row in rows if row.metric == "escapes" and row.method == "vmc") > 0


def test_the_page_says_what_was_missed():
    values = {
        "p50_ms": 4.0, "p95_ms": 12.0, "p99_ms": 20.0, "sent": 100.0, "lost": 0.0, "passed_over": 3.0,
        "samples_not_recorded": 0.0, "memory_mb_after_a_fifth": 300.0, "memory_mb_at_the_end": 301.0,
        "load_mean": 1.0, "load_most": 2.0,
    }  # fmt: skip
    rows = tuple(Row("endurance", "45 s", "", "none", metric, value) for metric, value in values.items())
    figures = live_figures(Results("live", "d", rows), "abc")
    assert "12.00 ms | **missed**" in figures
    assert "0 of 100 | met" in figures
    assert "300 and 301 MB | met" in figures
    other = Results("live", "d", (Row("faults", "x", "", "none", "failures", 0.0),))
    assert {row.table for row in with_rows_of(other, Results("live", "d", rows)).rows} == {"faults", "endurance"}


def test_a_jump_is_told_apart_from_what_a_late_device_causes() -> None:
    worn, body = layout("six-trackers"), average_body()
    facts = SessionFacts(worn, body, (), True, "m", ("m",), 0, (), True)
    times = np.r_[np.arange(0.0, 6.0, 1 / 60), np.arange(6.3, 12.0, 1 / 60)]
    q = np.zeros((len(times), body.size))
    q[times > 3.0, 0] += 0.2  # while one sensor is silent
    q[times > 6.1, 0] += 0.5  # after the device was kept waiting
    notebook = Notebook()
    notebook.open(facts, lambda _: None)
    for index, time in enumerate(times):
        positions = np.zeros((6, 3))
        positions[0 if time < 11.0 else slice(None)] = np.nan  # and at last the device ends
        nothing = np.full((6, 3), np.nan)
        unsaid = (np.full((6, 4), np.nan), nothing, nothing, nothing[:, 0])
        sample = Sample(time, time, positions, *unsaid, np.zeros(6, dtype=np.int64))
        frame = Frame(time, Pose(body, q[index]), np.zeros(body.size), Health())
        notebook.show(Update(index, sample, frame, time, Latency(*6 * [0.0]), Counters()))
    still = np.zeros(len(body))
    told = notebook.jumps(still, silent=1)
    assert told.largest == pytest.approx(20.0)
    assert told.kept_waiting == pytest.approx(50.0)
    assert told.waits == 1
    assert notebook.jumps(still, silent=None) == (pytest.approx(50.0), 0.0, 0)
    # What the joint does in the clip is no jump.
    assert notebook.jumps(still + 3.0, silent=1).largest == pytest.approx(15.0)
