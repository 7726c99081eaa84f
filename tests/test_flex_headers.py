"""Flex logs of any wording, order and kind of values: the right channel in the right place, or a refusal."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from poseloom.cli._app import run
from poseloom.errors import FormatError
from poseloom.formats.flex_headers import read_heading
from poseloom.formats.flex_log import LogNotes, read_flex_log
from poseloom.sensors import Recording, SensorStatus, layout

FOUR = layout("flex-four")
ROWS = 200
TIMES = 20 * np.arange(ROWS)
COUNTS = np.stack(
    [
        1000 + 800 * np.abs(np.sin(TIMES / 400)),
        2000 + 700 * np.abs(np.sin(TIMES / 500)),
        3000 + 600 * np.abs(np.sin(TIMES / 300)),
        300 + 500 * np.abs(np.sin(TIMES / 700)),
    ],
    axis=1,
).round()
WORDINGS = {
    name: tuple(
        pattern.format(side=side, Side=side.title(), SIDE=side.upper(), s=side[0], S=side[0].upper(), joint=joint,
                       Joint=joint.title(), JOINT=joint.upper())
        for pattern in ("{side} {joint}", "{joint}_{s}", "{S}_{Joint}", "{s}{joint}", "{Joint}{Side}",
                        "{Joint} ({side})",
                        "{SIDE}-{JOINT}", "{Side} {Joint} [adc]", "{s}{Joint}")
    )
    for name, side, joint in (("leftKnee", "left", "knee"), ("rightKnee", "right", "knee"),
                              ("leftElbow", "left", "elbow"), ("rightElbow", "right", "elbow"))
}  # fmt: skip


def log(header: list[str], columns: list[np.ndarray], delimiter: str = ",", pattern: str = "{:g}") -> str:
    rows = [delimiter.join(pattern.format(value) for value in row) for row in np.stack(columns, axis=1)]
    return "\n".join([delimiter.join(header), *rows] if header else rows) + "\n"


def read(folder: Path, text: str, encoding: str = "utf-8", **options: object) -> tuple[Recording, LogNotes]:
    path = folder / "log.csv"
    path.write_bytes(text.encode(encoding))
    return read_flex_log(path, FOUR, **options)  # type: ignore[arg-type]


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_names_decide_in_any_wording_and_order(tmp_path: Path, data: st.DataObject) -> None:
    style = data.draw(st.integers(0, 8))
    time = data.draw(st.sampled_from(["time", "Time (ms)", "millis", "t_ms", "Timestamp", "time [ms]"]))
    named = [(time, TIMES.astype(float)), *((WORDINGS[n][style], COUNTS[:, i]) for i, n in enumerate(FOUR.names))]
    if data.draw(st.booleans()):
        named.append(("battery", np.full(ROWS, 3.7)))
    order = data.draw(st.permutations(range(len(named))))
    delimiter = data.draw(st.sampled_from([",", ";", "\t"]))
    text = log([named[i][0] for i in order], [named[i][1] for i in order], delimiter)
    text = data.draw(st.sampled_from(["", "Booting v1.2 ...\n", "\n"])) + text
    recording, notes = read(tmp_path, text, data.draw(st.sampled_from(["utf-8", "utf-16", "utf-8-sig"])))
    np.testing.assert_array_equal(recording.counts, COUNTS)
    np.testing.assert_allclose(recording.times, TIMES / 1000, atol=1e-9)
    assert "columns" in notes.said


@pytest.mark.parametrize(
    "numbered", [("c1", "c2", "c3", "c4"), ("a0", "A1", "a2", "a3"), ("ch 1", "ch 2", "ch 3", "ch 4"), tuple("1234")]
)
def test_numbered_channels_are_in_the_layouts_order(tmp_path: Path, numbered: tuple[str, ...]) -> None:
    text = log([*numbered, "millis"], [*COUNTS.T, TIMES.astype(float)])
    np.testing.assert_array_equal(read(tmp_path, text)[0].counts, COUNTS)
    turned = log([*numbered[::-1], "millis"], [*COUNTS.T[::-1], TIMES.astype(float)])
    np.testing.assert_array_equal(read(tmp_path, turned)[0].counts, COUNTS)


@pytest.mark.parametrize(
    "header",
    [
        ("time", "foo", "bar", "baz", "qux"),
        ("time", "left knee", "left knee", "left elbow", "right elbow"),
        ("time", "knee", "knee 2", "elbow", "elbow 2"),
        ("time", "left hip", "right hip", "left elbow", "right elbow"),
        ("time", "A0", "A1", "A2", "A6"),
    ],
)
def test_a_header_that_is_not_understood_is_refused_and_never_taken_by_order(
    tmp_path: Path, header: tuple[str, ...]
) -> None:
    text = log(list(header), [TIMES.astype(float), *COUNTS.T])
    with pytest.raises(FormatError, match=f"the header names {header[0]}, {header[1]}") as caught:
        read(tmp_path, text)
    assert caught.value.line == 1
    assert "--columns" in caught.value.remedy
    named = ["time", "leftKnee", "rightKnee", "leftElbow", "rightElbow"]
    np.testing.assert_array_equal(read(tmp_path, text, columns=named)[0].counts, COUNTS)


@pytest.mark.parametrize("place", range(5))
def test_time_without_a_header_is_the_column_that_goes_up(tmp_path: Path, place: int) -> None:
    columns = list(COUNTS.T)
    columns.insert(place, TIMES.astype(float))
    recording, _ = read(tmp_path, log([], columns))
    np.testing.assert_array_equal(recording.counts, COUNTS)
    assert recording.layout.rate == 50


@pytest.mark.parametrize("arrow", [" -> ", " \u2192 "])
def test_the_arduino_ides_time_of_arrival(tmp_path: Path, arrow: str) -> None:
    body = log([], list(COUNTS.T)).splitlines()
    stamped = [f"23:59:{58 + i / 50:06.3f}" if i < 100 else f"00:00:{i / 50 - 2:06.3f}" for i in range(ROWS)]
    text = "\n".join(f"{stamp}{arrow}{line}" for stamp, line in zip(stamped, body, strict=True))
    recording, _ = read(tmp_path, text)
    np.testing.assert_array_equal(recording.counts, COUNTS)
    np.testing.assert_allclose(recording.times, TIMES / 1000, atol=1e-6)
    own = "\n".join(
        f"12:00:00.000{arrow}{line}"
        for line in log(["time", *FOUR.names], [TIMES.astype(float), *COUNTS.T]).splitlines()
    )
    np.testing.assert_allclose(read(tmp_path, own)[0].times, TIMES / 1000, atol=1e-9)


def test_decimals_are_counts_too(tmp_path: Path) -> None:
    means = COUNTS + 0.25
    for text in (
        log(["time", *FOUR.names], [TIMES.astype(float), *means.T], pattern="{:.2f}"),
        log(["time", *FOUR.names], [TIMES.astype(float), *means.T], ";", "{:.2f}").replace(".", ","),
    ):
        recording, notes = read(tmp_path, text)
        np.testing.assert_array_equal(recording.counts, means)
        assert "counts" in notes.said


@pytest.mark.parametrize(
    ("top", "header", "said"),
    [(5.0, "", "volts"), (3.3, "", "volts"), (3300.0, " (mV)", "millivolts"), (100.0, " (%)", "percent")],
)
def test_volts_and_percent_become_counts_and_it_is_said(tmp_path: Path, top: float, header: str, said: str) -> None:
    names = [name + header for name in FOUR.names]
    text = log(["time", *names], [TIMES.astype(float), *(COUNTS * top / 4095).T], pattern="{:.6f}")
    recording, notes = read(tmp_path, text, full_scale=5.0 if top == 5.0 else None)
    np.testing.assert_allclose(recording.counts, COUNTS, atol=0.01)
    assert said in notes.said
    assert said in recording.settings["read as"]
    np.testing.assert_allclose(read(tmp_path, text, values="counts")[0].counts, COUNTS * top / 4095, atol=1e-5)


@pytest.mark.parametrize("named", [True, False])
def test_degrees_are_refused(tmp_path: Path, named: bool) -> None:
    bends = COUNTS.T * (150 / 4095) - (0 if named else 20)
    text = log(
        ["time", *(f"{n} [deg]" if named else n for n in FOUR.names)], [TIMES.astype(float), *bends], pattern="{:.3f}"
    )
    with pytest.raises(FormatError, match="degrees"):
        read(tmp_path, text)


def test_values_that_may_be_anything_are_refused(tmp_path: Path) -> None:
    text = log(["time", *FOUR.names], [TIMES.astype(float), *(COUNTS * 90 / 4095).T], pattern="{:.3f}")
    with pytest.raises(FormatError, match="--values") as caught:
        read(tmp_path, text)
    assert caught.value.file == str(tmp_path / "log.csv")
    np.testing.assert_allclose(read(tmp_path, text, values="percent")[0].counts, COUNTS * 0.9, atol=0.05)


def test_a_skipped_line_advances_the_clock(tmp_path: Path) -> None:
    lines = log([], list(COUNTS.T)).splitlines()
    lines[50] = "12,5"
    lines[120] = "####garbage"[4:]
    recording, notes = read(tmp_path, "\n".join(lines), rate=50.0)
    kept = np.setdiff1d(np.arange(ROWS), [50, 120])
    np.testing.assert_allclose(recording.times, kept / 50)
    np.testing.assert_array_equal(recording.counts, COUNTS[kept])
    assert sum(notes.passed_over.values()) == 2


@pytest.mark.parametrize("share", [0.04, 0.06])
def test_more_than_five_percent_of_skipped_lines_is_an_error(tmp_path: Path, share: float) -> None:
    lines = log(["time", *FOUR.names], [TIMES.astype(float), *COUNTS.T]).splitlines()
    spoilt = np.linspace(20, ROWS - 20, round(share * ROWS)).astype(int)
    for at in spoilt:
        lines[at] = "brown-out"
    if share < 0.05:
        assert read(tmp_path, "\n".join(lines))[1].good == ROWS - len(spoilt)
    else:
        with pytest.raises(FormatError, match=f"{len(spoilt)} of {ROWS} lines cannot be used") as caught:
            read(tmp_path, "\n".join(lines))
        assert f"line {spoilt[0] + 1}" in caught.value.cause


def test_a_header_that_comes_again_after_a_restart_is_no_skipped_line(tmp_path: Path) -> None:
    text = log(["time", *FOUR.names], [TIMES.astype(float), *COUNTS.T])
    recording, notes = read(tmp_path, text + text)
    assert len(recording) == 2 * ROWS
    assert not notes.passed_over


def test_rails_in_volts_are_saturated(tmp_path: Path) -> None:
    volts = COUNTS * 5 / 4095
    volts[10, 0] = 5.0
    text = log(["time", *FOUR.names], [TIMES.astype(float), *volts.T], pattern="{:.3f}")
    assert read(tmp_path, text)[0].status[10, 0] == SensorStatus.SATURATED


def test_headings_say_kinds_and_units() -> None:
    found = read_heading(["Knee R (V)", "Time [us]", "l_elbow", "elbow_r", "left knee"], FOUR.names)
    assert [heading.name for heading in found] == ["rightKnee", "time", "leftElbow", "rightElbow", "leftKnee"]
    assert (found[0].values, found[1].unit) == ("volts", "us")


def test_the_command_states_columns_and_values(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, output = tmp_path / "log.csv", tmp_path / "log.mcap"
    path.write_text(log(["R knee", "L knee", "R elbow", "L elbow", "ms"], [*COUNTS.T, TIMES.astype(float)]))
    assert run(["import-flex", str(path), "-o", str(output)]) == 0
    said = capsys.readouterr().out
    assert "columns rightKnee, leftKnee, rightElbow, leftElbow, time" in said
    assert "values are counts" in said
    assert run(["import-flex", str(path), "-o", str(output), "--values", "furlongs"]) == 2
