"""Logs of flex sensors: what boards write, and what is left of it on a memory card."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from poseloom.cli._app import run
from poseloom.errors import FormatError
from poseloom.formats.clocks import read_clock
from poseloom.formats.flex_log import LogNotes, read_flex_log
from poseloom.formats.recording import read_recording
from poseloom.sensors import Recording, SensorStatus, layout

FOUR = layout("flex-four")


def counts(samples: int) -> np.ndarray:
    return np.random.default_rng(4).integers(600, 2000, (samples, 4)).astype(np.float64)


def lines(
    samples: int = 200, step: int = 50, start: int = 0, wrap: int = 0, pattern: str = "{t},{a},{b},{c},{d}"
) -> list[str]:
    told = []
    for index, (a, b, c, d) in enumerate(counts(samples).astype(int)):
        time = start + index * step
        told.append(pattern.format(t=time % wrap if wrap else time, a=a, b=b, c=c, d=d))
    return told


def read(tmp_path: Path, text: list[str] | bytes, **options: object) -> tuple[Recording, LogNotes]:
    path = tmp_path / "log.csv"
    path.write_bytes(text if isinstance(text, bytes) else "\n".join(text).encode())
    return read_flex_log(path, FOUR, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("rate", [20, 50, 100, 200])
def test_the_rate_comes_from_the_times(rate: int, tmp_path: Path) -> None:
    recording, notes = read(tmp_path, lines(step=1000 // rate))
    assert recording.layout.rate == rate
    np.testing.assert_array_equal(recording.counts, counts(200))
    np.testing.assert_allclose(recording.times, np.arange(200) / rate, atol=1e-9)
    assert not notes.passed_over


@pytest.mark.parametrize(
    ("header", "pattern", "scale"),
    [
        ("time,c1,c2,c3,c4", "{t},{a},{b},{c},{d}", 1),
        ("c4;c3;c2;c1;time_us", "{d};{c};{b};{a};{t}000", 1),
        ("ms\tleftKnee\trightKnee\tleftElbow\trightElbow", "{t}\t{a}\t{b}\t{c}\t{d}", 1),
        ("RightElbow LeftElbow RightKnee LeftKnee seconds", "{d} {c} {b} {a} {t}", 1000),
        ("# time, c2, c1, c3, c4, battery", "{t}, {b}, {a}, {c}, {d}, 3.71", 1),
    ],
)
def test_headers_say_order_and_unit(header: str, pattern: str, scale: int, tmp_path: Path) -> None:
    text = lines(pattern=pattern)
    if scale == 1000:
        text = [" ".join([*line.split()[:4], f"{int(line.split()[4]) / 1000:.3f}"]) for line in text]
    recording, _ = read(tmp_path, [header, *text])
    assert recording.layout.rate == 20
    np.testing.assert_array_equal(recording.counts, counts(200))


def test_labels_say_the_order_too(tmp_path: Path) -> None:
    recording, _ = read(tmp_path, lines(pattern="t={t} c2:{b} c1:{a} c4:{d} c3:{c}"))
    np.testing.assert_array_equal(recording.counts, counts(200))


def test_columns_may_be_named_by_hand(tmp_path: Path) -> None:
    text = lines(pattern="{t},9.81,{b},{a},{c},{d}")
    recording, _ = read(tmp_path, text, columns=["time", "-", "rightKnee", "leftKnee", "leftElbow", "rightElbow"])
    np.testing.assert_array_equal(recording.counts, counts(200))
    for wrong, said in (
        (["time", "rightKnee", "rightKnee", "leftElbow", "rightElbow"], "doubled"),
        (["time", "rightKnee"], "leftKnee"),
        (["time", "knee", "rightKnee", "leftElbow", "rightElbow"], "unknown column"),
    ):
        with pytest.raises(FormatError, match=said):
            read(tmp_path, text, columns=wrong)


@pytest.mark.parametrize(("wrap", "start"), [(2**16, 65_000), (2**32, 2**32 - 3000)])
def test_a_counter_that_wraps_goes_on(wrap: int, start: int, tmp_path: Path) -> None:
    recording, notes = read(tmp_path, lines(start=start, wrap=wrap))
    np.testing.assert_allclose(recording.times, np.arange(200) / 20, atol=1e-6)
    assert "wrapped" in notes.clock.events[0]


def test_midnight_is_a_wrap(tmp_path: Path) -> None:
    text = [f"{23 if i < 40 else 0}:{59 if i < 40 else 0:02}:{(58 + i * 0.05) % 60:06.3f},1,2,3,4" for i in range(200)]
    recording, _ = read(tmp_path, text)
    np.testing.assert_allclose(recording.times, np.arange(200) / 20, atol=1e-6)


def test_a_restart_goes_on_one_step_later(tmp_path: Path) -> None:
    recording, notes = read(tmp_path, lines(100, start=90_000) + lines(100, start=12))
    np.testing.assert_allclose(recording.times, np.arange(200) / 20, atol=1e-6)
    assert notes.clock.events == ("the device restarted",)


def test_garbage_is_passed_over_and_counted_and_the_rest_stays_in_place(tmp_path: Path) -> None:
    text = lines(300)
    text[3] = "12,5"  # cut short
    text[7] = "Booting v1.2 ..."
    text[50] = "\x00\xff,1,2,3,4"
    text[80] = "99999999,700,700,700,700"  # a stamp from nowhere
    text[90] = text[91][:14] + text[92]  # two writers
    text[100] = text[100][:9]
    text[120] = "0,5,5,5,5"
    text[200] = ""
    recording, notes = read(tmp_path, text)
    spoilt = [3, 7, 50, 80, 90, 100, 120, 200]
    kept = np.setdiff1d(np.arange(300), spoilt)
    np.testing.assert_allclose(recording.times, kept / 20, atol=1e-9)
    np.testing.assert_array_equal(recording.counts, counts(300)[kept])
    assert notes.lines == 299
    assert notes.good == 292
    assert sum(notes.passed_over.values()) == 7
    assert "lines passed over" in recording.settings


def test_a_missing_count_is_missing_and_rails_are_saturated(tmp_path: Path) -> None:
    text = lines(50)
    text[10] = "500,,800,9999,-"
    text[11] = "550,0,800,4095,700"
    recording, notes = read(tmp_path, text)
    assert list(np.isnan(recording.counts[10])) == [True, False, True, True]
    assert list(recording.status[10]) == [SensorStatus.MISSING, SensorStatus.OK, *2 * [SensorStatus.MISSING]]
    assert list(recording.status[11]) == [SensorStatus.SATURATED, 0, SensorStatus.SATURATED, 0]
    assert any("4095" in what for what in notes.passed_over)


def test_lines_without_a_time_need_a_rate(tmp_path: Path) -> None:
    text = lines(pattern="{a} {b} {c} {d}")
    with pytest.raises(FormatError, match="no time"):
        read(tmp_path, text)
    recording, _ = read(tmp_path, text, rate=20.0)
    np.testing.assert_allclose(recording.times, np.arange(200) / 20)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (b"", "empty"),
        (b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 20, "no log"),
        (b"a,b,c\n" * 30, "no log"),
        (b"5,1,2,3,4\n" * 30, "do not increase"),
        (b"\n".join(b"%d,1,2,3,4" % (i * 10**9) for i in range(30)), "neither seconds"),
        (b"time,c1,c2,c3,c4,c5\n" + b"\n".join(b"%d,1,2,3,4,5" % (i * 50) for i in range(30)), "c5"),
    ],
)
def test_what_is_no_log_is_refused_with_its_reason(text: bytes, said: str, tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=said):
        read(tmp_path, text)


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.binary(max_size=400), st.integers(0, 40), st.integers(1, 400))
def test_no_damage_makes_more_than_an_error(tmp_path: Path, damage: bytes, at: int, gone: int) -> None:
    whole = "\n".join(lines(60)).encode()
    place = at * 20
    try:
        recording, notes = read(tmp_path, whole[:place] + damage + whole[place + gone :])
    except FormatError:
        return
    assert (np.diff(recording.times) > 0).all()
    assert len(recording) == notes.good <= notes.lines
    assert np.nanmin(recording.counts) >= 0
    assert np.nanmax(recording.counts) <= 4095


@settings(max_examples=25, deadline=None)
@given(st.lists(st.integers(0, 2**33), min_size=3, max_size=60))
def test_clocks_always_increase(stamps: list[int]) -> None:
    try:
        clock = read_clock(np.array(stamps, dtype=np.float64))
    except FormatError:
        return
    assert (np.diff(clock.times) > 0).all()
    assert (np.diff(clock.kept) > 0).all()
    assert math.isfinite(clock.rate)


def test_the_command_writes_a_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, output = tmp_path / "LOG.TXT", tmp_path / "log.mcap"
    log.write_text("\r\n".join(["hello", *lines(step=20)]))
    assert run(["import-flex", str(log), "-o", str(output)]) == 0
    assert "200 of 201 lines" in capsys.readouterr().out
    assert read_recording(output).layout.rate == 50
    assert run(["import-flex", str(log), "-o", str(tmp_path / "log.csv")]) == 2
    assert run(["import-flex", str(tmp_path / "none"), "-o", str(output)]) == 2
