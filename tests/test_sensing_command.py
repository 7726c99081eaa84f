"""`poseloom simulate` end to end: motion file in, recording out, and messages without a traceback."""

import math
from pathlib import Path

import numpy as np
import pytest
import typer

from poseloom.cli import _app
from poseloom.cli._app import run
from poseloom.cli.sensing import register
from poseloom.formats import write_motion
from poseloom.formats.recording import read_recording
from poseloom.samples import sample_motions
from poseloom.sensors import SensorStatus, layout
from poseloom.skeleton.body import average_body
from poseloom.skeleton.motion import make_motion
from poseloom.synthesis import simulate_trackers


@pytest.fixture(autouse=True)
def only_this_command(monkeypatch: pytest.MonkeyPatch):
    app = typer.Typer(pretty_exceptions_enable=False)
    app.callback()(lambda: None)
    register(app)
    monkeypatch.setattr(_app, "build_app", lambda: app)


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    rng = np.random.default_rng(0)
    body = average_body()
    times = np.arange(241)[:, None] / 120.0
    motion = make_motion(body, 0.3 * np.sin(times * rng.uniform(1, 5, body.size)), 120.0, "swing")
    path = tmp_path_factory.mktemp("clips") / "swing.npz"
    write_motion(motion, path)
    return path


def test_a_motion_file_becomes_a_recording(clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    out = tmp_path / "swing.mcap"
    assert run(["simulate", str(clip), "-o", str(out), "--seed", "3", "--name", "[bold]mine"]) == 0
    told = capsys.readouterr().out
    assert "six-trackers, 40 Hz" in told
    assert "[bold]mine" in told
    recording = read_recording(out)
    assert recording.name == "[bold]mine"
    assert len(recording) == 81
    assert recording.truth is not None
    again = simulate_trackers(recording.truth, recording.layout, seed=3)
    np.testing.assert_array_equal(recording.positions, again.positions)
    np.testing.assert_array_equal(recording.quats_wxyz, again.quats_wxyz)


def test_every_option_reaches_the_recording(clip: Path, tmp_path: Path):
    out = tmp_path / "a.mcap"
    options = (
        "--layout three-trackers --noise-mm 1 --noise-deg 2 --bias-mm 3 --bias-deg 4 --drift-mm 5 --drift-deg 6"
        " --outliers 0.1 --drop-outs 0.2 --bursts 0.3 --latency-ms 7 --jitter-ms 8 --placement-error-mm 9"
        " --placement-error-deg 10 --seed 11 --start 0.5 --stop 1.5 --fault silent:head:0.2:0.4 --fault"
        " swap:leftHand+rightHand:0.5:0.6"
    )
    assert run(["simulate", str(clip), "-o", str(out), *options.split()]) == 0
    recording = read_recording(out)
    assert recording.layout == layout("three-trackers")
    assert len(recording) == 41
    told = {key.removeprefix("noise "): float(value) for key, value in recording.settings.items() if "noise " in key}
    expected = {
        "position_m": 0.001,
        "orientation_rad": math.radians(2),
        "bias_m": 0.003,
        "bias_rad": math.radians(4),
        "drift_m": 0.005,
        "drift_rad": math.radians(6),
        "outlier_probability": 0.1,
        "drop_out_probability": 0.2,
        "burst_rate_hz": 0.3,
        "latency_s": 0.007,
        "jitter_s": 0.008,
        "placement_m": 0.009,
        "placement_rad": math.radians(10),
    }
    assert {key: told[key] for key in expected} == pytest.approx(expected)
    assert recording.settings["seed"] == "11"
    assert recording.settings["faults"].count('"sensor"') == 2
    silent = (recording.times >= 0.2) & (recording.times < 0.4)
    assert (recording.status[silent, 0] == SensorStatus.MISSING).all()


def test_imus_are_worn_with_their_own_options(clip: Path, tmp_path: Path):
    out = tmp_path / "imus.mcap"
    options = (
        "--layout left-shank+head-imu --rate 100 --noise-m-s2 0.5 --noise-deg-s 2 --bias-m-s2 3 --bias-deg-s 4"
        " --bandwidth-hz 9 --range-g 2 --range-deg-s 300 --clock-ppm 50 --clock-offset-ms 6 --drop-outs 0.1"
        " --placement-error-mm 7 --placement-error-deg 8 --fault silent:head:0.5:1"
    )
    assert run(["simulate", str(clip), "-o", str(out), *options.split()]) == 0
    recording = read_recording(out)
    assert (recording.layout.name, recording.layout.rate, len(recording)) == ("left-shank+head-imu", 100.0, 201)
    told = {key.removeprefix("noise "): float(value) for key, value in recording.settings.items() if "noise " in key}
    expected = {
        "force_m_s2": 0.5,
        "rate_rad_s": math.radians(2),
        "force_bias_m_s2": 3.0,
        "rate_bias_rad_s": math.radians(4),
        "bandwidth_hz": 9.0,
        "force_range_m_s2": 2 * 9.80665,
        "rate_range_rad_s": math.radians(300),
        "clock_error": 5e-5,
        "clock_offset_s": 0.006,
        "drop_out_probability": 0.1,
        "placement_m": 0.007,
        "placement_rad": math.radians(8),
    }
    assert {key: told[key] for key in expected} == pytest.approx(expected)
    assert (recording.status[50:100, 1] == SensorStatus.MISSING).all()


@pytest.mark.parametrize("layout_name", ["six-trackers", "right-foot-imu"])
def test_ideal_sensors_err_only_as_asked(clip: Path, tmp_path: Path, layout_name: str):
    out = tmp_path / "ideal.mcap"
    command = ["simulate", str(clip), "-o", str(out), "--layout", layout_name, "--ideal", "--latency-ms", "5"]
    assert run(command) == 0
    told = {key: value for key, value in read_recording(out).settings.items() if key.startswith("noise ")}
    told = {key: value for key, value in told.items() if value != "inf"}
    sizes = ("seconds", "outlier")  # of what never happens
    assert {key for key in told if not any(size in key for size in sizes)} == {"noise latency_s"}


def test_a_sample_motion_becomes_a_recording(tmp_path: Path):
    name = next(iter(sample_motions()))
    assert run(["simulate", f"sample:{name}", "-o", str(tmp_path / "s.mcap"), "--noise-mm", "0"]) == 0
    assert len(read_recording(tmp_path / "s.mcap")) > 10


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["CLIP", "-o", "OUT.bvh"], "Name an .mcap file"),
        (["CLIP", "-o", "OUT.mcap", "--layout", "six-tracker"], "Did you mean 'six-trackers'"),
        (["CLIP", "-o", "OUT.mcap", "--layout", "hips-imu", "--noise-mm", "1"], "--noise-mm does not belong to IMUs"),
        (["CLIP", "-o", "OUT.mcap", "--clock-ppm", "1"], "--clock-ppm does not belong to trackers"),
        (["CLIP", "-o", "OUT.mcap", "--rate", "0"], "a rate of 0.0 Hz"),
        (["CLIP", "-o", "OUT.mcap", "--outliers", "2"], "outlier_probability is 2.0"),
        (["CLIP", "-o", "OUT.mcap", "--noise-mm", "-1"], "position_m is -0.001"),
        (["CLIP", "-o", "OUT.mcap", "--start", "5"], "lasts 2.00 s"),
        (["CLIP", "-o", "OUT.mcap", "--stop", "nan"], "no part from 0 s to nan s"),
        (["CLIP", "-o", "OUT.mcap", "--fault", "silent:head"], "KIND:SENSOR:START:STOP"),
        (["CLIP", "-o", "OUT.mcap", "--fault", "quiet:head:1:2"], "unknown kind of fault 'quiet'"),
        (["CLIP", "-o", "OUT.mcap", "--fault", "silent:foot:1:2"], "unknown sensor 'foot'"),
        (["sample:wlak", "-o", "OUT.mcap"], "Did you mean 'walk'"),
        (["none.bvh", "-o", "OUT.mcap"], "none.bvh"),
        (["CLIP", "-o", "nowhere/OUT.mcap"], "nowhere"),
    ],
)
def test_wrong_requests_end_with_a_message_and_nothing_written(
    clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
):
    places = {"CLIP": str(clip)}
    filled = [places.get(each, str(tmp_path / each) if "OUT" in each else each) for each in arguments]
    assert run(["simulate", *filled]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert "Traceback" not in error
    assert list(tmp_path.iterdir()) == []
