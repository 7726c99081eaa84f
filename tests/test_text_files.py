"""Text of unknown origin: encodings, line ends."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from poseloom.errors import FormatError
from poseloom.formats._files import decode, split_lines
from poseloom.formats.bend_tables import read_bend_tables
from poseloom.formats.expmap_csv import read_expmap
from poseloom.formats.imus import read_imu_tracks

PLAIN = "time,acc_x\r\n0.00,1.5\r\n0.01,-2.5\r\n"


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "latin-1"])
def test_encodings_are_recognised(encoding: str) -> None:
    assert decode(PLAIN.encode(encoding)) == PLAIN


def test_a_mark_stands_before_big_endian_text_and_letters_survive() -> None:
    assert decode(b"\xfe\xff" + "Zeit;Größe\n1;2\n".encode("utf-16-be")) == "Zeit;Größe\n1;2\n"
    assert decode("Größe °/s\n".encode("latin-1")) == "Größe °/s\n"
    assert decode("Größe °/s\n".encode()) == "Größe °/s\n"


def test_blocks_of_zeros_that_a_memory_card_lost_are_no_utf_16() -> None:
    assert decode(b"\0" * 4096 + b"1,2,3\n").strip("\0") == "1,2,3\n"


@given(st.binary(max_size=200))
def test_decoding_never_fails(content: bytes) -> None:
    assert isinstance(decode(content), str)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r", "\r\r\n"])
def test_line_ends_of_all_systems(end: str) -> None:
    assert split_lines(end.join(["a", "b\x85c\x0cd", "e", ""])) == ["a", "b\x85c\x0cd", "e"]
    assert split_lines(end.join(["a", "e"])) == ["a", "e"]


def test_an_exponential_map_table_in_another_dialect_is_the_same_motion(tmp_path: Path) -> None:
    bones = {
        "metres_per_unit": 1.0,
        "frame_rate_hz": 60,
        "joints": [{"name": "Hips", "parent": None, "offset": [0, 0, 0]},
                   {"name": "Leg", "parent": "Hips", "offset": [0, -1, 0]}],
    }  # fmt: skip
    (tmp_path / "skeleton.json").write_text(json.dumps(bones))
    rows = "".join(f"0.{i},1.5,2.0,0.1,-0.2,0.3,0.4,0.{i},0.5\n" for i in range(1, 6))
    (tmp_path / "plain.csv").write_text(rows)
    other = rows.replace(",", ";").replace(".", ",").replace("\n", ";\r\n") + "\r\n"
    (tmp_path / "other.csv").write_bytes(other.encode("utf-16"))
    motions = [read_expmap(tmp_path / name) for name in ("plain.csv", "other.csv")]
    np.testing.assert_array_equal(motions[0].q, motions[1].q)


STO = "DataRate=100.0\nDataType=Quaternion\nversion=3\nendheader\ntime\tpelvis_imu\tcalcn_r_imu\n"


def test_storage_files_with_tabs_at_line_ends_empty_lines_and_milliseconds(tmp_path: Path) -> None:
    path = tmp_path / "turns.sto"
    path.write_text(STO + "".join(f"{i / 100}\t1,0,0,0\t0.6,0.8,0,0\n" for i in range(20)))
    plain = read_imu_tracks(path)["calcn_r_imu"]
    lines = [*STO.splitlines(), *(f"{10 * i}\t1,0,0,0\t0.6,0.8,0,0" for i in range(20))]
    path.write_bytes(("\t\r\n".join(lines).replace("endheader\t", "endheader") + "\t\r\n\r\n").encode("utf-16"))
    other = read_imu_tracks(path)["calcn_r_imu"]
    np.testing.assert_allclose(other.times, plain.times)
    np.testing.assert_array_equal(other.quats_wxyz, plain.quats_wxyz)
    assert "time in ms" in other.notes[0]
    path.write_text(STO + "0,00\t1,0,0,0,0,0,0,0\t0,6,0,8,0,0,0,0\n")
    with pytest.raises(FormatError, match="commas stand between the parts and within the numbers"):
        read_imu_tracks(path)


def test_xsens_and_xio_tables_in_another_dialect(tmp_path: Path) -> None:
    names = "PacketCounter;Acc_X;Acc_Y;Acc_Z;Gyr_X;Gyr_Y;Gyr_Z;"
    rows = [f"{i};0,5;0,25;9,75;0,125;0,5;-0,25;" for i in range(20)]
    text = "\r\n".join(["// Update Rate: 100.0Hz", names, *rows, "", ""])
    (tmp_path / "walk_00B4.txt").write_bytes(text.encode("utf-16"))
    track = read_imu_tracks(tmp_path / "walk_00B4.txt")["00B4"]
    np.testing.assert_allclose(track.specific_forces[3], [0.5, 0.25, 9.75])
    folder = tmp_path / "Left Foot 64F0EBCE (UDP)"
    folder.mkdir()
    head = ";".join(
        ["Timestamp (us)", *(f"Gyroscope {a} (deg/s)" for a in "XYZ"), *(f"Accelerometer {a} (g)" for a in "XYZ")]
    )
    (folder / "Inertial.csv").write_text(
        "\n".join([head, *(f"{i * 10000};180,0;0,0;0,0;0,0;0,0;1,0" for i in range(20))])
    )
    np.testing.assert_allclose(read_imu_tracks(folder)["Left Foot"].angular_rates[2], [np.pi, 0, 0])


def test_bend_tables_in_another_dialect(tmp_path: Path) -> None:
    rows = [f"{500 + i % 7};{600 - i % 5};{90 + i % 11},5;" for i in range(600)]
    (tmp_path / "abc_1.csv").write_bytes("\r\n".join(["r1;r2;angle;", *rows, ""]).encode("utf-8-sig"))
    (found,) = read_bend_tables(tmp_path)
    assert found.channels == ("r1", "r2")
    np.testing.assert_allclose(found.bends[:3], np.radians([89.5, 88.5, 87.5]))
