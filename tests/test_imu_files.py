"""Readers of real IMU recordings: what the formats say, the quirks of real ones, and files that are damaged."""

import math
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from poseloom.errors import FormatError, PoseloomError, SensorError
from poseloom.formats.imus import ImuTrack, assemble_imus, make_track, read_imu_tracks
from poseloom.rotations import matrix_from_quat, quat_from_matrix, quat_from_rotvec, quat_rotate
from poseloom.sensors import SensorStatus

G = 9.80665
# A sensor whose x axis points up in a world whose z does.
R_ZUP_SENSOR = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])


def write(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def xsens(folder: Path, rows: list[str], columns: str | None = None, separator: str = ",") -> Path:
    names = (
        columns or "PacketCounter,SampleTimeFine,Acc_X,Acc_Y,Acc_Z,Gyr_X,Gyr_Y,Gyr_Z,Quat_q0,Quat_q1,Quat_q2,Quat_q3"
    )
    head = "// Start Time: Unknown\n// Update Rate: 100.0Hz\n"
    text = head + "\n".join([names, *rows]).replace(",", separator) + "\n"
    return write(folder / "Walk-1-000_00B40C48.txt", text)


def row(counter: int) -> str:
    quat = quat_from_matrix(R_ZUP_SENSOR)
    return f"{counter},,9.80665,0,0,0.1,0.2,0.3," + ",".join(f"{part:.6f}" for part in quat)


def only(tracks: object) -> ImuTrack:
    assert isinstance(tracks, dict) or hasattr(tracks, "values")
    (track,) = tracks.values()  # type: ignore[attr-defined]
    return track


def points_up(track: ImuTrack) -> np.ndarray:
    """The mean specific force in the world; up is y."""
    return np.nanmean(quat_rotate(track.quats_wxyz, track.specific_forces), axis=0)


def test_xsens_counts_packets_across_their_end_and_over_losses(tmp_path: Path):
    track = only(read_imu_tracks(xsens(tmp_path, [row(65534), row(65535), row(0), row(3)])))
    assert track.name == "00B40C48"
    np.testing.assert_allclose(np.diff(track.times), [0.01, 0.01, 0.03])
    np.testing.assert_allclose(track.angular_rates, np.tile([0.1, 0.2, 0.3], (4, 1)))
    np.testing.assert_allclose(points_up(track), [0, G, 0], atol=1e-5)


def test_xsens_matrices_stand_column_by_column(tmp_path: Path):
    names = "PacketCounter,Acc_X,Acc_Y,Acc_Z," + ",".join(f"Mat[{r}][{c}]" for c in (1, 2, 3) for r in (1, 2, 3))
    cells = ",".join(str(R_ZUP_SENSOR[r, c]) for c in range(3) for r in range(3))
    track = only(read_imu_tracks(xsens(tmp_path, [f"0047{i},{G},0,0,{cells}" for i in range(5)], names, "\t")))
    np.testing.assert_allclose(points_up(track), [0, G, 0], atol=1e-9)
    assert np.isnan(track.angular_rates).all()


def test_missing_cells_are_missing_values(tmp_path: Path):
    rows = [row(0), row(1).replace("9.80665", ""), row(2).replace("0.1", "nan")]
    track = only(read_imu_tracks(xsens(tmp_path, rows)))
    np.testing.assert_array_equal(np.isnan(track.specific_forces).all(axis=1), [False, True, False])
    np.testing.assert_array_equal(np.isnan(track.angular_rates).all(axis=1), [False, False, True])


def test_a_last_line_that_was_cut_off_is_dropped(tmp_path: Path):
    path = xsens(tmp_path, [row(i) for i in range(4)])
    path.write_text(path.read_text()[:-30])
    assert len(only(read_imu_tracks(path))) == 3


@pytest.mark.parametrize(
    ("rows", "message", "line"),
    [
        ([row(0), "1,,2,3"], "this line has 4 cells", 5),
        ([row(0), row(1).replace("0.2", "abc")], "'abc' in column 'Gyr_Y' is not a number", 5),
        ([row(0), row(1)[1:]], "no packet counter", 5),
        ([row(0)], "has 1 samples", None),
        ([], "no sample in this file", None),
        ([row(5), row(4)], "go back", None),
        ([row(0), row(1).replace("9.80665", "1e400")], "infinite", None),
    ],
)
def test_damaged_xsens_files_say_where(tmp_path: Path, rows: list[str], message: str, line: int | None):
    path = xsens(tmp_path, rows)
    with pytest.raises(FormatError, match=message) as caught:
        read_imu_tracks(path)
    assert caught.value.file == str(path)
    assert caught.value.line == line


def mvnx(folder: Path, frames: int = 4, lame: str = "") -> Path:
    quat = " ".join(f"{part:.9f}" for part in quat_from_matrix(R_ZUP_SENSOR))
    body = "".join(
        f'<frame time="{round(i / 60 * 1000)}" index="{i}" type="normal">'
        f"<sensorFreeAcceleration>0 0 1 {'1' if lame != 'short' else ''} 0 0</sensorFreeAcceleration>"
        f"<sensorOrientation>{quat} {quat}</sensorOrientation></frame>"
        for i in range(frames)
    )
    text = (
        '<?xml version="1.0"?>\n<mvnx xmlns="http://www.xsens.com/mvn/mvnx"><subject frameRate="60"><sensors>'
        '<sensor label="Pelvis"/><sensor label="RightHand"/></sensors><frames>'
        f'<frame time="0" type="tpose"></frame>{body}</frames></subject></mvnx>'
    )
    return write(folder / "take.mvnx", text)


def test_mvnx_adds_gravity_to_free_acceleration(tmp_path: Path):
    tracks = read_imu_tracks(mvnx(tmp_path))
    assert list(tracks) == ["Pelvis", "RightHand"]
    np.testing.assert_allclose(tracks["Pelvis"].times, np.arange(4) / 60)
    np.testing.assert_allclose(tracks["Pelvis"].specific_forces, np.tile([G + 1, 0, 0], (4, 1)), atol=1e-6)
    # 1 m/s^2 along the file's x axis is the sensor's -z.
    np.testing.assert_allclose(tracks["RightHand"].specific_forces[0], [G, 0, -1], atol=1e-6)
    np.testing.assert_allclose(points_up(tracks["Pelvis"]), [0, G + 1, 0], atol=1e-6)


def test_damaged_mvnx_is_refused(tmp_path: Path):
    with pytest.raises(FormatError, match="frame 0 has 5 values of sensorFreeAcceleration, not 6"):
        read_imu_tracks(mvnx(tmp_path, lame="short"))
    path = mvnx(tmp_path)
    whole = path.read_text()
    path.write_text(whole[: len(whole) // 2])
    with pytest.raises(FormatError, match="no whole XML file") as caught:
        read_imu_tracks(path)
    assert caught.value.line is not None
    path.write_text(whole.replace("<mvnx", '<!DOCTYPE x [<!ENTITY a "b">]><mvnx'))
    with pytest.raises(FormatError, match="entities"):
        read_imu_tracks(path)
    path.write_text(whole.replace('type="normal"', 'type="tpose"'))
    with pytest.raises(FormatError, match="no motion trackers"):
        read_imu_tracks(path)


@pytest.mark.parametrize("field", ["sensorOrientation", "sensorFreeAcceleration"])
def test_mvnx_without_a_field_says_which(tmp_path: Path, field: str):
    path = mvnx(tmp_path)
    path.write_text(path.read_text().replace(field, "jointAngle"))
    with pytest.raises(FormatError, match=f"no frame has the field {field}") as caught:
        read_imu_tracks(path)
    assert caught.value.file == str(path)
    assert "jointAngle" in caught.value.cause


@pytest.mark.parametrize("rate", ["0", "-60", "nan", "inf", "1e-300", "abc", "1e9", ""])
@pytest.mark.filterwarnings("error")
def test_mvnx_with_an_impossible_frame_rate_is_refused_before_any_arithmetic(tmp_path: Path, rate: str):
    path = mvnx(tmp_path)
    path.write_text(path.read_text().replace('frameRate="60"', f'frameRate="{rate}"'))
    with pytest.raises(FormatError, match="frameRate"):
        read_imu_tracks(path)


def xio(folder: Path, lost: int | None = None) -> Path:
    times = [917410905 + 20035 * i for i in range(30)]
    head = "Timestamp (us)," + ",".join(f"Gyroscope {a} (deg/s)" for a in "XYZ")
    head += "," + ",".join(f"Accelerometer {a} (g)" for a in "XYZ")
    rows = [f"{t},180,0,0,1,0,0" for i, t in enumerate(times) if i != lost]
    write(folder / "Right Foot 64F619FB (UDP)" / "Inertial.csv", "\n".join([head, *rows]) + "\n")
    quat = quat_from_matrix(R_ZUP_SENSOR)
    turned = [f"{t}," + ",".join(f"{part:.6f}" for part in quat) for i, t in enumerate(times) if i != 3]
    write(
        folder / "Right Foot 64F619FB (UDP)" / "Quaternion.csv", "\n".join(["Timestamp (us),W,X,Y,Z", *turned]) + "\n"
    )
    write(folder / "notes" / "readme.txt", "no sensor")
    return folder


def test_xio_folders_with_blanks_in_their_names(tmp_path: Path):
    track = only(read_imu_tracks(xio(tmp_path / "logged lower body", lost=10)))
    assert track.name == "Right Foot"
    assert len(track) == 29
    np.testing.assert_allclose(track.specific_forces[0], [G, 0, 0])
    np.testing.assert_allclose(track.angular_rates[0], [math.pi, 0, 0])
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(track.quats_wxyz[:, 0])), [3])
    assert only(read_imu_tracks(tmp_path / "logged lower body" / "Right Foot 64F619FB (UDP)")).name == "Right Foot"


GAITMAP_AXES = ("acc_x", "acc_y", "acc_z", "gyr_x", "gyr_y", "gyr_z")


def test_gaitmap_tables_with_sensors_in_any_order(tmp_path: Path):
    mixed = "sensor," + ",".join(f"{side},{'right' if side == 'left' else 'left'}" for side in ["left"] * 6)
    axes = "axis," + ",".join(f"{axis},{axis}" for axis in GAITMAP_AXES)
    rows = [f"{i}," + ",".join(f"{k},{-k}" for k in (1, 2, 9.5, 4, 5, 6)) for i in range(5)]
    path = write(tmp_path / "imu.csv", "\n".join([mixed, axes, *rows]) + "\n")
    tracks = read_imu_tracks(path, 200.0)
    np.testing.assert_allclose(tracks["left"].specific_forces[0], [1, 2, 9.5])
    np.testing.assert_allclose(tracks["right"].angular_rates[0], np.radians([-4, -5, -6]))
    np.testing.assert_allclose(np.diff(tracks["left"].times), 0.005)
    with pytest.raises(FormatError, match="--source-rate"):
        read_imu_tracks(path)
    path.write_text(path.read_text().replace("gyr_z", "gyr_q"))
    with pytest.raises(FormatError, match="0 columns 'gyr_z'") as caught:
        read_imu_tracks(path, 200.0)
    assert caught.value.line == 2


def test_gaitmap_tables_that_tell_seconds_need_no_rate(tmp_path: Path):
    head = "," + ",".join(["left_sensor"] * 6) + "\n," + ",".join(GAITMAP_AXES) + "\n"
    rows = [f"{i / 204.8},1,2,9.5,4,5,6" for i in range(5)]
    track = only(read_imu_tracks(write(tmp_path / "stairs.csv", head + "\n".join(rows) + "\n")))
    assert track.step == pytest.approx(1 / 204.8)
    single = ",index," + ",".join(GAITMAP_AXES) + "\n" + "\n".join(f"{i},{i},1,2,9.5,4,5,6" for i in range(5)) + "\n"
    assert only(read_imu_tracks(write(tmp_path / "one.csv", single), 100.0)).name == "one"


def test_storage_files_of_quaternions(tmp_path: Path):
    quat = ",".join(f"{part:.6f}" for part in quat_from_matrix(R_ZUP_SENSOR))
    head = "DataRate=100.0\nDataType=Quaternion\nversion=3\nendheader\ntime\tpelvis_imu\tcalcn_r_imu\n"
    lines = [f"{417 + i / 100}\t{quat}\t{quat}" for i in range(4)]
    path = write(tmp_path / "turns.sto", head + "\n".join(lines) + "\n")
    tracks = read_imu_tracks(path)
    assert list(tracks) == ["pelvis_imu", "calcn_r_imu"]
    up = matrix_from_quat(tracks["pelvis_imu"].quats_wxyz[0]) @ np.array([1.0, 0.0, 0.0])
    np.testing.assert_allclose(up, [0, 1, 0], atol=1e-6)
    path.write_text(head + lines[0] + "\n" + lines[1].replace("\t", " ") + "\n")
    with pytest.raises(FormatError, match="a time and 2 quaternions") as caught:
        read_imu_tracks(path)
    assert caught.value.line == 7
    path.write_text(path.read_text().replace("Quaternion", "Vec3"))
    with pytest.raises(FormatError, match="no quaternions"):
        read_imu_tracks(path)


def test_matlab_structures(tmp_path: Path):
    path = tmp_path / "body.mat"
    values = np.array([0.0, 1.0, 9.7]) + 0.01 * np.arange(30.0).reshape(10, 3)
    scipy.io.savemat(path, {"t": np.arange(10) / 100, "hip": {"acc": values, "gyr": -values}, "other": 3.0})
    track = only(read_imu_tracks(path))
    assert track.name == "hip"
    np.testing.assert_allclose(track.angular_rates, -values)
    scipy.io.savemat(path, {"t": np.arange(9) / 100, "hip": {"acc": values, "gyr": -values}})
    with pytest.raises(FormatError, match=r"hip.acc has shape \(10, 3\)"):
        read_imu_tracks(path)
    scipy.io.savemat(path, {"t": np.arange(9) / 100})
    with pytest.raises(FormatError, match="no inertial sensors"):
        read_imu_tracks(path)
    path.write_bytes(path.read_bytes()[:150])
    with pytest.raises(FormatError):
        read_imu_tracks(path)


def test_unknown_files_and_doubled_sensors_are_refused(tmp_path: Path):
    with pytest.raises(FormatError, match="no inertial recording"):
        read_imu_tracks(write(tmp_path / "notes.txt", "hello"))
    with pytest.raises(FormatError, match="no inertial recording"):
        read_imu_tracks(tmp_path)
    with pytest.raises(FormatError, match="no such file"):
        read_imu_tracks(tmp_path / "none.csv")
    path = xsens(tmp_path / "a", [row(0), row(1)])
    again = xsens(tmp_path / "b", [row(0), row(1)])
    with pytest.raises(FormatError, match="two sensors '00B40C48'"):
        read_imu_tracks([path, again])


@pytest.mark.parametrize("seed", range(5))
def test_garbage_never_escapes_as_another_error(tmp_path: Path, seed: int):
    rng = np.random.default_rng(seed)
    good = {
        ".txt": xsens(tmp_path, [row(i) for i in range(6)]).read_bytes(),
        ".mvnx": mvnx(tmp_path).read_bytes(),
        ".sto": b"DataType=Quaternion\nendheader\ntime\ta\n1\t1,0,0,0\n2\t1,0,0,0\n",
        ".csv": b"//fs=100\nacc_1,acc_2,acc_3,gyr_1,gyr_2,gyr_3\n1,2,3,4,5,6\n1,2,3,4,5,6\n",
    }
    told: list[bool] = []
    for suffix, content in good.items():
        for _ in range(20):
            bad = bytearray(content)
            for place in rng.integers(len(bad), size=rng.integers(1, 8)):
                bad[place] = rng.integers(256)
            path = tmp_path / f"bad{suffix}"
            path.write_bytes(bytes(bad[: rng.integers(1, len(bad) + 1)]))
            try:
                read_imu_tracks(path)
            except PoseloomError as error:
                told.append(error.file == str(path))
    assert told
    assert all(told)


def track_of(function: object, times: np.ndarray, name: str = "s") -> ImuTrack:
    assert callable(function)
    return make_track(name, times, Path("x"), specific_forces=function(times), angular_rates=function(times))


def slow_wave(times: np.ndarray) -> np.ndarray:
    return np.stack([np.sin(3 * times), np.cos(2 * times), times], axis=1)


def test_clocks_apart_are_read_off_at_the_same_moments():
    first = track_of(slow_wave, 900.0 + np.arange(400) / 100)
    second = track_of(slow_wave, 900.013 + np.arange(200) * 0.020035, "t")
    recording = assemble_imus({"right-foot": first, "left-foot": second}, bandwidth_hz=math.inf)
    assert recording.layout.name == "right-foot+left-foot-imu"
    expected = slow_wave(900.013 + recording.times)
    for sensor in (0, 1):
        np.testing.assert_allclose(recording.specific_forces[:, sensor], expected, atol=1e-4)
    assert recording.duration == pytest.approx(3.97, abs=0.02)


def test_what_lies_in_a_gap_is_missing_and_nothing_else():
    times = np.arange(300) / 100
    keep = np.ones(300, dtype=bool)
    keep[100:103] = False
    recording = assemble_imus({"hips": track_of(slow_wave, times[keep])}, bandwidth_hz=math.inf)
    gone = recording.status[:, 0] == SensorStatus.MISSING
    np.testing.assert_array_equal(gone, (recording.times > 0.99 + 1e-9) & (recording.times < 1.03 - 1e-9))
    np.testing.assert_allclose(recording.specific_forces[~gone, 0], slow_wave(recording.times[~gone]), atol=1e-4)


def test_channels_may_be_lost_apart():
    times = np.arange(300) / 100
    forces, rates = slow_wave(times), slow_wave(times)
    forces[50:60] = np.nan
    recording = assemble_imus({"hips": make_track("s", times, Path("x"), specific_forces=forces, angular_rates=rates)})
    lost = np.isnan(recording.specific_forces[:, 0, 0])
    assert 4 <= lost.sum() <= 7
    assert np.isfinite(recording.angular_rates).all()
    assert (recording.status == SensorStatus.OK).all()


def test_angular_rates_come_from_orientations_where_there_are_none():
    times = np.arange(300) / 100
    spin = np.array([0.3, -0.5, 1.1])
    quats = quat_from_rotvec(times[:, None] * spin)  # a constant rate, in world and sensor alike
    recording = assemble_imus({"hips": make_track("s", times, Path("x"), quats_wxyz=quats)})
    np.testing.assert_allclose(recording.angular_rates[:, 0], np.tile(spin, (len(recording), 1)), atol=1e-6)
    assert recording.settings["angular rates derived from orientations"] == "s"


def test_fast_vibration_is_filtered_out_before_the_rate_falls():
    times = np.arange(2000) / 400
    recording = assemble_imus({"hips": track_of(lambda t: np.sin(2 * np.pi * 59 * t)[:, None] * np.ones(3), times)})
    assert np.abs(recording.specific_forces[30:-30]).max() < 1e-3


def test_recordings_that_never_overlap_are_refused():
    first, second = track_of(slow_wave, np.arange(100) / 100), track_of(slow_wave, 5 + np.arange(100) / 100, "t")
    with pytest.raises(FormatError, match="no moment in common"):
        assemble_imus({"hips": first, "head": second})
    with pytest.raises(SensorError, match="nothing was recorded"):
        assemble_imus({"hips": first}, start=2.0)
    with pytest.raises(SensorError, match="unknown place"):
        assemble_imus({"hip": first})


REAL = {
    "neura_walk/imu": (None, 11, ["specific_forces", "angular_rates", "quats_wxyz"]),
    "opensense/OpenSenseExampleIMUData": (None, 8, ["specific_forces", "quats_wxyz"]),
    "opensense/MT_012005D6_009-quaternions_RHJCSwinger.sto": (None, 8, ["quats_wxyz"]),
    "qmt_fullbody/examples/full_body_example_data.mat": (None, 16, ["specific_forces", "angular_rates"]),
    "xio_lower_body/Examples/logged_lower_body": (None, 7, ["specific_forces", "angular_rates", "quats_wxyz"]),
    "xsens_mvnx/io_anim_mvnx_utest/data/test_mocap.mvnx": (None, 11, ["specific_forces", "quats_wxyz"]),
    "gaitmap/imu_sample.csv": (204.8, 2, ["specific_forces", "angular_rates"]),
    "gaitmap/imu_sample_healthy_stair_up.csv": (None, 2, ["specific_forces", "angular_rates"]),
    "gaitmap/imu_sample_ms_left.csv": (102.4, 1, ["specific_forces", "angular_rates"]),
}


@pytest.mark.recordings
@pytest.mark.parametrize("name", REAL)
def test_real_recordings(recordings: Path, name: str):
    rate, count, channels = REAL[name]
    tracks = read_imu_tracks(recordings / "imu" / name, rate)
    assert len(tracks) == count
    for track in tracks.values():
        for channel in ("specific_forces", "angular_rates", "quats_wxyz"):
            known = np.isfinite(getattr(track, channel)).all(axis=1).mean()
            assert known > 0.97 if channel in channels else known == 0
        if {"specific_forces", "quats_wxyz"} <= set(channels):
            assert points_up(track)[1] == pytest.approx(G, abs=0.2)
            assert np.hypot(*points_up(track)[[0, 2]]) < 0.5


@pytest.mark.recordings
def test_the_cut_of_a_real_walk_is_its_raw_file(recordings: Path):
    folder = recordings / "imu" / "neura_walk" / "imu"
    raw = only(read_imu_tracks(folder / "S02-Trial-Walk-1-000_00B40C48.txt"))
    cut = only(read_imu_tracks(folder / "S02-Trial-Walk-1-R_Foot.csv"))
    np.testing.assert_array_equal(raw.specific_forces[1119:2074], cut.specific_forces)
    np.testing.assert_array_equal(raw.angular_rates[1119:2074], cut.angular_rates)


@pytest.mark.recordings
def test_rotated_and_unrotated_tables_agree(recordings: Path):
    tables = [
        read_imu_tracks(recordings / "imu" / "gaitmap" / f"imu_sample{kind}.csv", 204.8)
        for kind in ("", "_not_rotated")
    ]
    for side in ("left_sensor", "right_sensor"):
        first, second = (np.linalg.norm(table[side].specific_forces, axis=1) for table in tables)
        np.testing.assert_allclose(first, second, atol=1e-9)
