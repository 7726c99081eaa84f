"""Tables of foreign trackers: other axes, units, orders and dialects give the same recording, or a refusal."""

from pathlib import Path

import numpy as np
import pytest

from poseloom.cli._app import run
from poseloom.errors import FormatError
from poseloom.formats.column_map import read_column_map
from poseloom.formats.recording import read_recording
from poseloom.formats.tracker_tables import TrackerChoices, read_tracker_table
from poseloom.rotations import matrix_from_quat, quat_from_matrix
from poseloom.samples import sample_motions
from poseloom.sensors import Recording, layout
from poseloom.skeleton.retarget import retarget
from poseloom.synthesis import simulate_trackers
from poseloom.synthesis.noise import NO_NOISE

AXES = {
    "y up": np.eye(3),
    "z up": np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
    "Unity": np.diag([-1.0, 1.0, 1.0]),
    "Unreal": np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
}
"""From our axes to a file's."""


@pytest.fixture(scope="module")
def walk() -> Recording:
    return simulate_trackers(retarget(sample_motions()["walk"]), layout("six-trackers"), NO_NOISE)


def table(recording: Recording, axes: np.ndarray, size: float = 1.0, order: str = "wxyz", delimiter: str = ",",
          pattern: str = "{name}_{part}", time: str = "time") -> str:  # fmt: skip
    places = recording.positions @ axes.T * size
    turns = axes @ matrix_from_quat(recording.quats_wxyz) @ axes.T
    quats = quat_from_matrix(turns)
    quats = quats if order == "wxyz" else np.roll(quats, -1, axis=-1)
    parts = (*"xyz", *(f"q{axis}" for axis in order))
    names = [time, *(pattern.format(name=name, part=part) for name in recording.layout.names for part in parts)]
    scale = 1000 if time.endswith("ms") else 1
    rows = np.concatenate([places, quats], axis=-1).reshape(len(recording), -1)
    lines = [
        delimiter.join([f"{scale * t:.6f}", *(f"{v:.8f}" for v in row)])
        for t, row in zip(recording.times, rows, strict=True)
    ]
    return "\n".join([delimiter.join(names), *lines]) + "\n"


def check(found: Recording, wanted: Recording) -> None:
    assert found.layout.names == wanted.layout.names
    assert found.layout.rate == pytest.approx(wanted.layout.rate, rel=1e-3)
    # The heading of a world with another axis up is the file's own: compare relative to the first sample's head
    turn, offset = best_heading(found.positions, wanted.positions)
    np.testing.assert_allclose(found.positions @ turn.T + offset, wanted.positions, atol=2e-4)
    relative = matrix_from_quat(found.quats_wxyz[0]).swapaxes(-1, -2) @ matrix_from_quat(found.quats_wxyz)
    angles = np.trace(relative, axis1=-2, axis2=-1)
    expected = matrix_from_quat(wanted.quats_wxyz[0]).swapaxes(-1, -2) @ matrix_from_quat(wanted.quats_wxyz)
    np.testing.assert_allclose(angles, np.trace(expected, axis1=-2, axis2=-1), atol=1e-3)
    # Turning in the world: of each tracker from the first sample, seen in the found world
    world = matrix_from_quat(found.quats_wxyz) @ matrix_from_quat(found.quats_wxyz[0]).swapaxes(-1, -2)
    truth = matrix_from_quat(wanted.quats_wxyz) @ matrix_from_quat(wanted.quats_wxyz[0]).swapaxes(-1, -2)
    np.testing.assert_allclose(turn @ world @ turn.T, truth, atol=1e-3)


def best_heading(found: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    a = (found - found[0, 0]).reshape(-1, 3)
    b = (wanted - wanted[0, 0]).reshape(-1, 3)
    angle = np.arctan2(np.sum(a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2]), np.sum(a[:, 0] * b[:, 0] + a[:, 2] * b[:, 2]))
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    return turn, wanted[0, 0] - turn @ found[0, 0]


@pytest.mark.parametrize("axes", AXES)
@pytest.mark.parametrize(("size", "unit"), [(1.0, "m"), (100.0, "cm"), (1000.0, "mm")])
def test_axes_units_and_orders_give_the_same_recording(
    tmp_path: Path, walk: Recording, axes: str, size: float, unit: str
) -> None:
    path = tmp_path / "walk.csv"
    order = "xyzw" if size == 100 else "wxyz"
    path.write_text(table(walk, AXES[axes], size, order))
    left = np.linalg.det(AXES[axes]) < 0
    found, notes = read_tracker_table(path, TrackerChoices(handedness="left" if left else ""))
    check(found, walk)
    said = "; ".join(notes)
    assert f"positions in {unit}" in said
    assert ("z is up" if axes in ("z up", "Unreal") else "y is up") in said
    assert ("left-handed axes, as given" if left else "right-handed axes") in said


def test_left_handed_axes_are_noticed_in_walking(tmp_path: Path, walk: Recording) -> None:
    path = tmp_path / "walk.csv"
    path.write_text(table(walk, AXES["Unity"]))
    with pytest.raises(FormatError, match="left and right are exchanged"):
        read_tracker_table(path)


@pytest.mark.parametrize("pattern", ["{name}.{part}", "{name} {part}", "{name}_{part}"])
def test_dialects_and_wordings(tmp_path: Path, walk: Recording, pattern: str) -> None:
    text = table(walk, AXES["z up"], 100.0, "xyzw", "\t", pattern, "Timestamp_ms").replace(".", ",")
    text = text.replace("\thead,", "\thead.") if pattern == "{name}.{part}" else text
    path = tmp_path / "walk.tsv"
    path.write_bytes(text.replace("\n", "\t\r\n").encode("utf-16"))
    check(read_tracker_table(path)[0], walk)


def test_a_column_map_and_numbered_quaternions(tmp_path: Path, walk: Recording) -> None:
    lines = table(walk, AXES["y up"], order="xyzw").splitlines()
    names = [f"v{i}" for i in range(43)]
    path, toml = tmp_path / "walk.csv", tmp_path / "map.toml"
    path.write_text("\n".join([",".join(names), *lines[1:]]))
    with pytest.raises(FormatError, match="no tracker head"):
        read_tracker_table(path)
    sensors = "".join(
        f"[sensors.{name}]\nposition = {names[1 + 7 * i : 4 + 7 * i]}\nquaternion = {names[4 + 7 * i : 8 + 7 * i]}\n"
        for i, name in enumerate(walk.layout.names)
    )
    toml.write_text('time = "v0"\n' + sensors)
    with pytest.raises(FormatError, match="--quat-order"):
        read_tracker_table(path, TrackerChoices(columns=read_column_map(toml)))
    toml.write_text('time = "v0"\nquaternion_order = "xyzw"\nup = "y"\n' + sensors)
    check(read_tracker_table(path, TrackerChoices(columns=read_column_map(toml)))[0], walk)


@pytest.mark.parametrize(
    ("change", "choices", "said"),
    [
        (("head_qw", "head_roll"), {}, "rotations"),
        (("head_x", "hat_x"), {}, "head"),
        (("", ""), {"length_unit": "parsec"}, "no unit of length"),
        (("", ""), {"up": "w"}, "no axis"),
        (("", ""), {"quat_order": "zyxw"}, "no order"),
        (("", ""), {"handedness": "both"}, "no handedness"),
    ],
)
def test_what_cannot_be_is_refused(
    tmp_path: Path, walk: Recording, change: tuple[str, str], choices: dict[str, str], said: str
) -> None:
    path = tmp_path / "walk.csv"
    path.write_text(table(walk, AXES["y up"]).replace(*change))
    with pytest.raises(FormatError, match=said) as caught:
        read_tracker_table(path, TrackerChoices(**choices))  # type: ignore[arg-type]
    assert caught.value.file == str(path)


def test_giants_are_refused_unless_the_unit_is_given(tmp_path: Path, walk: Recording) -> None:
    path = tmp_path / "walk.csv"
    path.write_text(table(walk, AXES["y up"], 7.0))
    with pytest.raises(FormatError, match="--length-unit"):
        read_tracker_table(path)
    check(read_tracker_table(path, TrackerChoices(length_unit=str(1 / 7)))[0], walk)


def test_the_command(tmp_path: Path, walk: Recording, capsys: pytest.CaptureFixture[str]) -> None:
    path, output = tmp_path / "walk.csv", tmp_path / "walk.mcap"
    path.write_text(table(walk, AXES["z up"], 100.0))
    assert run(["import-trackers", str(path), "-o", str(output)]) == 0
    said = capsys.readouterr().out
    for fact in ("z is up", "positions in cm", "w, x, y, z as the columns say", "calibrate"):
        assert fact in said
    check(read_recording(output), walk)
