"""Text tables of inertial sensors: any dialect, wording, unit, clock and order gives the same motion, or a refusal."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from poseloom.cli._app import run
from poseloom.errors import FormatError
from poseloom.formats.column_map import read_column_map
from poseloom.formats.column_names import FORCE, OTHER, POSITION, QUAT, RATE, read_column_name
from poseloom.formats.imus import ImuChoices, ImuTrack, read_imu_tracks
from poseloom.formats.recording import read_recording
from poseloom.rotations import matrix_from_quat, quat_conjugate, quat_from_rotvec, quat_multiply, quat_rotate

G = 9.80665
RATE_HZ = 100.0
SAMPLES = 700
FORCE_SIZES = {"m/s2": 1.0, "g": G, "mg": G / 1000}
RATE_SIZES = {"rad/s": 1.0, "deg/s": math.pi / 180, "mdps": math.pi / 180000}
TIME_SIZES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


def swinging(samples: int = SAMPLES) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Times, specific forces, angular rates and quaternions (z up) of a shank that hangs still, then swings."""
    times = np.arange(samples) / RATE_HZ
    swings = np.clip(times - 2.0, 0.0, None)
    angle = 0.5 * np.sin(2 * np.pi * 0.9 * swings) * np.clip(swings, 0, 1)
    tilted = quat_from_rotvec(np.array([0.3, -0.2, 0.0]))
    quats = quat_multiply(quat_from_rotvec(angle[:, None] * np.array([0.2, 1.0, 0.1])), tilted)
    rate = np.gradient(angle, times)[:, None] * np.array([0.2, 1.0, 0.1])
    rng = np.random.default_rng(3)
    up = np.tile([0.0, 0.0, G], (samples, 1))
    up[:, 0] += 1.5 * np.sin(2 * np.pi * 0.9 * swings)
    forces = quat_rotate(quat_conjugate(quats), up) + 0.02 * rng.normal(size=(samples, 3))
    rates = quat_rotate(quat_conjugate(quats), rate) + 0.002 * rng.normal(size=(samples, 3))
    return times, forces, rates, quats


TIMES, FORCES, RATES, QUATS = swinging()
PLAIN = ("time", "acc_x", "acc_y", "acc_z", "gyr_x", "gyr_y", "gyr_z")


def table(
    names: tuple[str, ...],
    columns: np.ndarray,
    *,
    delimiter: str = ",",
    decimal: str = ".",
    end: str = "\n",
    trailing: str = "",
    digits: int = 9,
) -> str:
    rows = [delimiter.join(f"{value:.{digits}f}".replace(".", decimal) for value in row) + trailing for row in columns]
    return end.join([delimiter.join(names) + trailing, *rows]) + end


def plain_columns(force: str = "m/s2", rate: str = "deg/s", time: str = "s") -> np.ndarray:
    parts = (TIMES[:, None] / TIME_SIZES[time], FORCES / FORCE_SIZES[force], RATES / RATE_SIZES[rate])
    return np.concatenate(parts, axis=1)


def write(folder: Path, text: str, name: str = "shank.csv", encoding: str = "utf-8") -> Path:
    path = folder / name
    path.write_bytes(text.encode(encoding))
    return path


def read(path: Path, **choices: object) -> ImuTrack:
    (track,) = read_imu_tracks(path, choices=ImuChoices(**choices)).values()  # type: ignore[arg-type]
    return track


def check(track: ImuTrack) -> None:
    """The motion is the one that every table here holds."""
    np.testing.assert_allclose(track.times - track.times[0], TIMES, atol=1.1e-3)
    np.testing.assert_allclose(track.specific_forces, FORCES, atol=1e-4)
    np.testing.assert_allclose(track.angular_rates, RATES, atol=1e-4)


@pytest.mark.parametrize("force", FORCE_SIZES)
@pytest.mark.parametrize("rate", ["rad/s", "deg/s"])
@pytest.mark.parametrize("time", TIME_SIZES)
def test_units_are_told_from_values_and_stated(tmp_path: Path, force: str, rate: str, time: str) -> None:
    track = read(write(tmp_path, table(PLAIN, plain_columns(force, rate, time))))
    check(track)
    said = "; ".join(track.notes)
    for unit in (f"specific force in {force},", f"angular rate in {rate},", f"time in {time},"):
        assert unit in said


@pytest.mark.parametrize(
    ("names", "units"),
    [
        (
            ("Time (s)", *(f"Accelerometer {a} (g)" for a in "XYZ"), *(f"Gyroscope {a} (deg/s)" for a in "XYZ")),
            "g deg/s s",
        ),
        (("time_ms", "ax", "ay", "az", "gx", "gy", "gz"), "m/s2 rad/s ms"),
        (("Timestamp [µs]", *(f"acc_{a}_mg" for a in "xyz"), *(f"gyr_{a}_mdps" for a in "xyz")), "mg mdps us"),
        (
            ("timestamp", *(f"linear_acceleration.{a}" for a in "xyz"), *(f"angular_velocity.{a}" for a in "xyz")),
            "m/s2 rad/s ns",
        ),
        (("seconds_elapsed", *(f"Accel{a}[m/s²]" for a in "XYZ"), *(f"Gyro{a} (°/s)" for a in "XYZ")), "m/s2 deg/s s"),
        (("Zeit", *(f"ACC_{a}" for a in "XYZ"), *(f"GYRO_{a}" for a in "XYZ")), "g rad/s index"),
    ],
)
def test_any_usual_wording_is_understood(tmp_path: Path, names: tuple[str, ...], units: str) -> None:
    force, rate, time = units.split()
    columns = plain_columns(force, rate, time if time != "index" else "s")
    choices = {"rate": 100.0} if time == "index" else {}
    check(read(write(tmp_path, table(names, columns)), **choices))


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_every_dialect_gives_the_same_motion(tmp_path: Path, data: st.DataObject) -> None:
    delimiter = data.draw(st.sampled_from([",", ";", "\t", "|", "  "]))
    decimal = data.draw(st.sampled_from(".," if delimiter != "," else "."))
    order = data.draw(st.permutations(range(7)))
    text = table(
        tuple(PLAIN[i] for i in order),
        plain_columns(data.draw(st.sampled_from(list(FORCE_SIZES))), "deg/s", data.draw(st.sampled_from(["s", "ms"])))[
            :, order
        ],
        delimiter=delimiter,
        decimal=decimal,
        end=data.draw(st.sampled_from(["\n", "\r\n", "\r"])),
        trailing=data.draw(st.sampled_from(["", delimiter, delimiter * 2])),
    )
    text = data.draw(st.sampled_from(["", "# made by hand\n", "sep=" + delimiter[0] + "\n"])) + text
    text += data.draw(st.sampled_from(["", "\n", "\r\n", delimiter * 3 + "\n"]))
    encoding = data.draw(st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"]))
    name = data.draw(st.sampled_from(["shank.csv", "shank.txt", "shank.tsv"]))
    check(read(write(tmp_path, text, name, encoding)))


def test_quoted_cells_with_decimal_commas_between_commas(tmp_path: Path) -> None:
    rows = [",".join(f'"{value:.6f}"'.replace(".", ",") for value in row) for row in plain_columns()]
    check(read(write(tmp_path, "\n".join([",".join(f'"{name}"' for name in PLAIN), *rows]))))


def test_decimal_commas_between_commas_are_refused_for_that_reason(tmp_path: Path) -> None:
    path = write(tmp_path, table(PLAIN, plain_columns()).replace(".", ","))
    with pytest.raises(FormatError, match="commas stand between the cells and within the numbers") as caught:
        read_imu_tracks(path)
    assert caught.value.line == 2


def test_points_and_commas_in_one_file_are_refused(tmp_path: Path) -> None:
    text = table(PLAIN, plain_columns(), delimiter=";")
    path = write(tmp_path, text.replace("9.", "9,", 1))
    with pytest.raises(FormatError, match="decimal points, others decimal commas"):
        read_imu_tracks(path)


@pytest.mark.parametrize("size", [1.0, 1 / G, 1000 / G])
@pytest.mark.parametrize("word", ["acc", "LinearAcceleration", "FreeAcc"])
def test_acceleration_without_gravity_is_refused(tmp_path: Path, size: float, word: str) -> None:
    columns = plain_columns()
    columns[:, 1:4] -= quat_rotate(quat_conjugate(QUATS), np.tile([0.0, 0.0, G], (SAMPLES, 1)))
    columns[:, 1:4] *= size
    path = write(tmp_path, table(("time", *(f"{word}_{a}" for a in "xyz"), *PLAIN[4:]), columns))
    with pytest.raises(FormatError, match="gravity is not in the acceleration") as caught:
        read_imu_tracks(path)
    assert caught.value.file == str(path)
    with pytest.raises(FormatError, match="gravity is not in the acceleration"):
        read(path, accel_unit="g")


def test_a_unit_that_a_name_says_wrongly_is_refused_unless_given(tmp_path: Path) -> None:
    names = ("time_ms", *(f"acc_{a} (g)" for a in "xyz"), *(f"gyr_{a} (rad/s)" for a in "xyz"))
    path = write(tmp_path, table(names, plain_columns(time="ms")))
    with pytest.raises(FormatError, match=r"9\.8\d*, but its columns say g") as caught:
        read_imu_tracks(path)
    assert "--accel-unit m/s2" in caught.value.remedy
    with pytest.raises(FormatError, match="say rad/s, but that cannot be"):
        read(path, accel_unit="m/s2")
    check(read(path, accel_unit="m/s2", gyro_unit="deg/s"))
    with pytest.raises(FormatError, match="'time_s' says s, but goes up by 10"):
        read_imu_tracks(
            write(tmp_path, path.read_text().replace("time_ms", "time_s").replace("(g)", "").replace("(rad/s)", ""))
        )


def test_raw_counts_are_refused_with_their_size(tmp_path: Path) -> None:
    columns = plain_columns("g")
    columns[:, 1:4] *= 16384
    path = write(tmp_path, table(PLAIN, columns))
    with pytest.raises(FormatError, match="raw counts of 16384 a g") as caught:
        read_imu_tracks(path)
    size = caught.value.remedy.rpartition(" ")[2].rstrip(")")
    np.testing.assert_allclose(read(path, accel_unit=size).specific_forces, FORCES, rtol=1e-4, atol=1e-4)


def test_a_gyroscope_at_rest_needs_a_unit_where_its_noise_does_not_say(tmp_path: Path) -> None:
    columns = plain_columns()[:150]
    columns[:, 4:] = [0.03, 0.02, 0.01]
    path = write(tmp_path, table(PLAIN, columns))
    with pytest.raises(FormatError, match="--gyro-unit"):
        read_imu_tracks(path)
    np.testing.assert_allclose(read(path, gyro_unit="rad/s").angular_rates[0], [0.03, 0.02, 0.01])
    np.testing.assert_allclose(read(path, gyro_unit="0.5").angular_rates[0], [0.015, 0.01, 0.005])


def test_fast_turning_in_radians_is_told_from_slow_degrees_by_gravity(tmp_path: Path) -> None:
    spin = 25.0  # rad/s or deg/s: both are what a body may do
    times = np.arange(600) / 400.0
    for unit, size in (("rad/s", 1.0), ("deg/s", math.pi / 180)):
        angle = size * np.sin(spin * times)
        forces = G * np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=1)
        forces[::7] *= 1.02
        turning = -spin * np.cos(spin * times)[:, None] * np.array([0.0, 1.0, 0.0])
        columns = np.concatenate([times[:, None], forces, turning], axis=1)
        if unit == "deg/s":
            columns[:, 1:4] += 0.4 * np.sin(9 * times)[:, None]
        track = read(write(tmp_path, table(PLAIN, columns)), accel_unit="m/s2")
        np.testing.assert_allclose(track.angular_rates, size * turning)


def test_clock_times_and_epochs(tmp_path: Path) -> None:
    rows = plain_columns()
    start = 1_700_000_000
    written = {
        "epoch ms": [f"{start * 1000 + round(1000 * t)}" for t in TIMES],
        "epoch us": [f"{start * 1_000_000 + round(1e6 * t)}" for t in TIMES],
        "epoch ns": [f"{start * 10**9 + round(1e9 * t)}" for t in TIMES],
        "epoch s": [f"{start + t:.3f}" for t in TIMES],
        "iso": [f"2024-05-01T23:59:{58 + t:06.3f}Z" if t < 2 else f"2024-05-02 00:00:{t - 2:06.3f}" for t in TIMES],
        "clock": [f"23:59:{58 + t:06.3f}" if t < 2 else f"00:00:{t - 2:06.3f}" for t in TIMES],
        "clock with commas": [f'"12:30:{t:06.3f}"'.replace(".", ",") for t in TIMES],
        "micros that wrap": [f"{(2**32 - 3_000_000 + round(1e6 * t)) % 2**32}" for t in TIMES],
    }
    for what, times in written.items():
        lines = [f"{t}," + ",".join(f"{v:.6f}" for v in row[1:]) for t, row in zip(times, rows, strict=True)]
        check(read(write(tmp_path, "\n".join([",".join(PLAIN).replace("time", "timestamp"), *lines]), f"{what}.csv")))


@pytest.mark.parametrize(
    ("times", "choices", "said"),
    [
        (np.arange(SAMPLES) * 1.0, {}, "does not say how many"),
        (np.floor(TIMES), {}, "repeat the one before"),
        (np.zeros(SAMPLES), {}, "do not increase"),
        (TIMES, {"rate": 50.0}, "100 samples a second, but 50 were given"),
        (TIMES * 37, {}, "in no unit of time"),
        (TIMES, {"time_unit": "fortnight"}, "no unit of time"),
    ],
)
def test_times_that_cannot_be_right_are_refused(
    tmp_path: Path, times: np.ndarray, choices: dict[str, object], said: str
) -> None:
    columns = plain_columns()
    columns[:, 0] = times
    with pytest.raises(FormatError, match=said):
        read(write(tmp_path, table(PLAIN, columns)), **choices)


def test_rows_are_counted_where_the_user_says_so(tmp_path: Path) -> None:
    columns = plain_columns()
    columns[:, 0] = np.floor(TIMES)
    check(read(write(tmp_path, table(PLAIN, columns)), rate=100.0, time_unit="index"))
    columns[:, 0] = 5 + np.arange(SAMPLES)
    check(read(write(tmp_path, table(PLAIN, columns)), rate=100.0))
    check(read(write(tmp_path, table(PLAIN, columns)), time_unit="0.01"))


def test_coarse_milliseconds_do_not_change_the_rate(tmp_path: Path) -> None:
    columns = plain_columns(time="ms")
    columns[1::2, 0] += 0.3
    track = read(write(tmp_path, table(("time_ms", *PLAIN[1:]), columns, digits=6)))
    assert track.step == pytest.approx(0.01, rel=1e-3)


def with_quats(order: str, names: tuple[str, ...], quats: np.ndarray = QUATS) -> tuple[tuple[str, ...], np.ndarray]:
    turned = quats if order == "wxyz" else np.roll(quats, -1, axis=1)
    return (*PLAIN, *names), np.concatenate([plain_columns(rate="rad/s"), turned], axis=1)


@pytest.mark.parametrize(
    ("order", "names"),
    [
        ("wxyz", ("qw", "qx", "qy", "qz")),
        ("xyzw", ("quat_x", "quat_y", "quat_z", "quat_w")),
        ("wxyz", ("q0", "q1", "q2", "q3")),
        ("xyzw", ("ori_1", "ori_2", "ori_3", "ori_4")),
    ],
)
def test_the_order_of_quaternions_is_checked_by_gravity(tmp_path: Path, order: str, names: tuple[str, ...]) -> None:
    track = read(write(tmp_path, table(*with_quats(order, names))))
    check(track)
    up = quat_rotate(track.quats_wxyz, track.specific_forces)[:150].mean(axis=0)
    np.testing.assert_allclose(up, [0, G, 0], atol=0.05)
    assert any(f"orientation: {order if 'x' not in names[0] else 'wxyz'}" in note for note in track.notes)
    # The same turning as the file's, up to the world's axes
    relative = quat_multiply(quat_conjugate(track.quats_wxyz[0]), track.quats_wxyz[400])
    np.testing.assert_allclose(
        matrix_from_quat(relative), matrix_from_quat(quat_multiply(quat_conjugate(QUATS[0]), QUATS[400])), atol=1e-6
    )


def test_names_that_say_a_wrong_order_are_refused_unless_it_is_given(tmp_path: Path) -> None:
    names, columns = with_quats("xyzw", ("qw", "qx", "qy", "qz"))
    path = write(tmp_path, table(names, columns))
    with pytest.raises(FormatError, match="gravity then strays") as caught:
        read_imu_tracks(path)
    assert "--quat-order xyzw" in caught.value.remedy
    track = read(path, quat_order="xyzw")
    np.testing.assert_allclose(
        quat_rotate(track.quats_wxyz, track.specific_forces)[:150].mean(axis=0), [0, G, 0], atol=0.05
    )
    assert np.isnan(read(path, quat_order="none").quats_wxyz).all()


@pytest.mark.parametrize(
    "turn",
    [quat_from_rotvec(np.array(v)) for v in ([-math.pi / 2, 0.0, 0.0], [math.pi, 0.0, 0.0])],
    ids=["y up", "z down"],
)
@pytest.mark.parametrize("inverted", [False, True])
def test_worlds_with_another_up_and_inverted_quaternions(tmp_path: Path, turn: np.ndarray, inverted: bool) -> None:
    quats = quat_multiply(turn, QUATS)
    names, columns = with_quats("wxyz", ("qw", "qx", "qy", "qz"), quat_conjugate(quats) if inverted else quats)
    track = read(write(tmp_path, table(names, columns)))
    felt = quat_rotate(track.quats_wxyz, track.specific_forces)
    np.testing.assert_allclose(felt[:150].mean(axis=0), [0, G, 0], atol=0.05)
    assert any(("the world to the sensor" in note) == inverted for note in track.notes if "orientation" in note)


def test_numbered_quaternions_that_nothing_checks_need_an_order(tmp_path: Path) -> None:
    names, columns = with_quats("wxyz", ("q0", "q1", "q2", "q3"))
    path = write(tmp_path, table((names[0], *names[7:]), columns[:, [0, 7, 8, 9, 10]]))
    with pytest.raises(FormatError, match="--quat-order"):
        read_imu_tracks(path)
    assert np.isfinite(read(path, quat_order="wxyz").quats_wxyz).all()
    gyro = write(tmp_path, table((names[0], *names[4:]), columns[:, [0, *range(4, 11)]]), "gyro.csv")
    assert any("wxyz, as the gyroscope turns" in note for note in read(gyro).notes)
    broken = columns.copy()
    broken[:, 7:] *= 3
    with pytest.raises(FormatError, match="no quaternions"):
        read_imu_tracks(write(tmp_path, table(names, broken), "broken.csv"))


def test_sensors_stand_in_names_or_in_a_row_above_with_units_below(tmp_path: Path) -> None:
    columns = plain_columns()
    both = np.concatenate([columns, -columns[:, 1:]], axis=1)
    flat = tuple(f"{side}_{name}" for side in ("left_foot", "right_foot") for name in PLAIN[1:])
    first = write(tmp_path, table(("time", *flat), both), "flat.csv")
    head = ";left;;;;;;right;;;;;\n"
    unit = "s;" + ";".join((["m/s^2"] * 3 + ["deg/s"] * 3) * 2)
    names = "time;" + ";".join(PLAIN[1:] * 2)
    rows = table(PLAIN, both, delimiter=";").partition("\n")[2]
    second = write(tmp_path, f"{head}{names}\n{unit}\n{rows}", "rows.csv")
    for path, left, right in ((first, "left_foot", "right_foot"), (second, "left", "right")):
        tracks = read_imu_tracks(path)
        assert list(tracks) == [left, right]
        check(tracks[left])
        np.testing.assert_allclose(tracks[right].specific_forces, -FORCES, atol=1e-4)
    assert any("as the column names say" in note for note in read_imu_tracks(second)["left"].notes)


def test_a_preamble_and_a_header_in_a_comment_are_passed_over(tmp_path: Path) -> None:
    text = table(PLAIN, plain_columns())
    check(read(write(tmp_path, "DeviceTag:,shank\nFirmware:,2.0\n\n" + text)))
    check(read(write(tmp_path, "# " + text)))


def test_a_column_map_names_any_columns(tmp_path: Path) -> None:
    names, columns = with_quats("xyzw", ("o1", "o2", "o3", "o4"))
    path = write(tmp_path, table(("Zeit", *"abcdef", *names[7:]), columns))
    with pytest.raises(FormatError):
        read_imu_tracks(path)
    toml = tmp_path / "map.toml"
    toml.write_text(
        'time = "Zeit"\nquaternion_order = "xyzw"\n[sensors.shank]\nacceleration = ["a", "b", "c"]\n'
        'angular_rate = ["d", "e", "f"]\nquaternion = ["o1", "o2", "o3", "o4"]\n'
    )
    track = read(path, columns=read_column_map(toml))
    check(track)
    assert track.name == "shank"
    for wrong, said in (
        ("[sensors.x]\nacceleration = [1, 2, 3]", "not a list of 3"),
        ("speed = 3", "unknown setting 'speed'"),
        ("rate = -1", "rate"),
        ("[sensors.x]\nspin = []", "unknown part"),
        ("= = =", "TOML"),
        ('[sensors.x]\nacceleration = ["a", "b", "zzz"]', "no column 'zzz'"),
        ('[sensors.x]\nposition = ["a", "b", "c"]', "position"),
    ):
        toml.write_text(wrong)
        with pytest.raises(FormatError, match=said):
            read(path, columns=read_column_map(toml))


@pytest.mark.parametrize(
    ("name", "column"),
    [
        ("Acc_X", (FORCE, "x", "", "")),
        ("userAcceleration.x (G)", (FORCE, "x", "g", "")),
        ("00B421E6_gyr_z", (RATE, "z", "", "00B421E6")),
        ("rotationRate.y (rad/s)", (RATE, "y", "rad/s", "")),
        ("imu1_ax", (FORCE, "x", "", "imu1")),
        ("gyroscope_rad_s_z", (RATE, "z", "rad/s", "")),
        ("left hand qw", (QUAT, "w", "", "left_hand")),
        ("head_pos_x (mm)", (POSITION, "x", "mm", "head")),
        ("mag_x", (OTHER, "", "", "")),
        ("Roll", (OTHER, "", "", "")),
    ],
)
def test_column_names(name: str, column: tuple[str, str, str, str]) -> None:
    assert tuple(read_column_name(name))[:4] == column


def test_the_command_states_what_it_found_and_takes_options(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write(tmp_path, table(PLAIN, plain_columns("mg"), delimiter=";", decimal=","))
    output = tmp_path / "shank.mcap"
    sensor = ["--sensors", "right-shank=shank", "--align", "none", "-o", str(output)]
    assert run(["import-imu", str(path), *sensor]) == 0
    said = capsys.readouterr().out
    for fact in (
        "specific force in mg",
        "angular rate in deg/s",
        "time in s",
        "100 samples a second",
        "decimal commas",
    ):
        assert fact in said
    assert "specific force in mg" in read_recording(output).settings["read as"]
    assert run(["import-imu", str(path), "--accel-unit", "0.00980665", *sensor]) == 0
    assert "as given" in capsys.readouterr().out
    assert run(["import-imu", str(path), "--accel-unit", "stone"]) == 2
