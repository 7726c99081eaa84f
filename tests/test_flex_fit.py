"""Fitting flex sensors: known sensors are found again, what shipped is what is used, the page and the command work."""

import json
import math
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from poseloom.cli._app import run
from poseloom.errors import FormatError
from poseloom.formats.bend_tables import BendTable, read_bend_tables, read_displaced_tables
from poseloom.synthesis import FlexSensors, Spread
from poseloom.synthesis.flex_figures import sensors_from_json, sensors_to_json, spread_of
from poseloom.synthesis.flex_fit import Shape, curve, fit_channel, own_residuals
from poseloom.synthesis.flex_study import displacement_figures, study_flex_sensors

RATE = 50.0


def bends(seconds: float, seed: int) -> np.ndarray:
    """An elbow that bends at changing speeds and depths, radians."""
    time = np.arange(round(seconds * RATE)) / RATE
    generator = np.random.default_rng(seed)
    phase = np.cumsum(1.2 + 0.6 * np.sin(0.4 * time + generator.uniform(0, 6))) / RATE * 2 * np.pi
    depth = 1.0 + 0.6 * np.sin(0.7 * time + generator.uniform(0, 6))
    return 0.3 + 0.6 * depth * (1 - np.cos(phase))


def table(name: str, shapes: list[Shape], seconds: float = 60.0, noise: float = 0.3) -> BendTable:
    seed = sum(map(ord, name))
    bent = bends(seconds, seed)
    generator = np.random.default_rng(seed)
    minutes = np.arange(len(bent)) / RATE / 60
    columns = [
        1000
        + 40 * i
        + (80 + 20 * i) * curve(shape, bent, RATE)
        + 2 * minutes
        + noise * generator.normal(size=len(bent))
        for i, shape in enumerate(shapes)
    ]
    counts = np.round(np.stack(columns, axis=1))
    return BendTable(name, name.rpartition("_")[0], RATE, tuple(f"r{i + 1}" for i in range(len(shapes))), bent, counts)


@pytest.mark.parametrize("shape", [Shape(2.0, 0.08, 0.0, 1.0), Shape(4.0, 0.0, 0.25, 1.0), Shape(1.0, 0.05, 0.15, 2.0)])
def test_a_known_sensor_is_found_again(shape: Shape) -> None:
    fit = fit_channel(table("a_1", [shape], noise=0.1), 0)
    assert fit is not None
    assert fit.shape.curvature == pytest.approx(shape.curvature, abs=0.25)
    assert fit.shape.hysteresis == pytest.approx(shape.hysteresis, abs=0.02)
    assert fit.shape.lag_share == pytest.approx(shape.lag_share, abs=0.08)
    assert fit.drift == pytest.approx(2.0, abs=0.5)
    assert fit.range == pytest.approx(80.0, rel=0.1)
    assert np.nanstd(fit.residuals) < 0.01


def test_a_wrong_truth_now_and_then_does_not_bend_the_curve() -> None:
    sound = table("a_1", [Shape(3.0, 0.04, 0.0, 1.0)])
    bent = sound.bends.copy()
    bent[1000:1100] += 0.6
    spoilt = BendTable(sound.name, sound.person, RATE, sound.channels, bent, sound.counts)
    fit = fit_channel(spoilt, 0)
    assert fit is not None
    assert fit.shape.curvature == pytest.approx(3.0, abs=0.5)


def test_a_broken_contact_is_left_out_and_counted() -> None:
    whole = table("a_1", [Shape(2.0, 0.03, 0.0, 1.0)])
    counts = whole.counts.copy()
    for begin in range(500, 2500, 200):
        counts[begin : begin + 10] = 90.0
    fit = fit_channel(BendTable("a_1", "a", RATE, ("r1",), whole.bends, counts), 0)
    assert fit is not None
    assert fit.breaks == 10
    assert fit.broken == pytest.approx(100 / 3000)
    assert fit.shape.curvature == pytest.approx(2.0, abs=0.3)
    assert (
        fit_channel(
            BendTable("a_1", "a", RATE, ("r1",), whole.bends, np.where(np.arange(3000)[:, None] % 3, 90.0, counts)), 0
        )
        is None
    )


def test_what_all_channels_share_is_taken_out() -> None:
    shape = Shape(2.0, 0.02, 0.0, 1.0)
    sound = table("a_1", [shape] * 4)
    wobble = 0.15 * np.sin(np.arange(3000) / 7.0)
    spoilt = BendTable("a_1", "a", RATE, sound.channels, np.maximum(sound.bends + wobble, 0), sound.counts)
    fits = [fit for at in range(4) if (fit := fit_channel(spoilt, at)) is not None]
    own = own_residuals(fits)
    assert np.nanstd(fits[0].residuals) > 3 * np.nanstd(own[0].residuals)


def test_figures_and_their_judgement() -> None:
    shapes = [Shape(2.0, 0.05, 0.1, 1.0), Shape(3.0, 0.05, 0.1, 1.0), Shape(4.0, 0.05, 0.1, 1.0)]
    tables = [table(name, shapes) for name in ("a_1", "a_2", "b_1", "b_2")]
    study = study_flex_sensors(tables)
    assert study.held_back == ("a_2", "b_2")
    assert study.sensors.curvature.median == pytest.approx(24 ** (1 / 3), rel=0.1)
    assert study.sensors.hysteresis.median == pytest.approx(0.05, abs=0.015)
    assert len(study.judgements) == 6
    for judged in study.judgements:
        assert judged.counts < judged.straight_counts
        assert judged.degrees < judged.straight_degrees
        assert judged.own_counts < 1.5
    with pytest.raises(FormatError, match="two recordings"):
        study_flex_sensors(tables[:1])


def test_spreads_are_geometric() -> None:
    spread = spread_of([1.0, 4.0], 0.1)
    assert spread.median == pytest.approx(2.0)
    assert spread.log_sd == pytest.approx(math.log(2.0))


def test_what_is_used_is_what_shipped_and_json_goes_there_and_back() -> None:
    text = files("poseloom.synthesis").joinpath("flex_sensors.json").read_text(encoding="utf-8")
    assert sensors_from_json(text) == FlexSensors()
    content = json.loads(text)
    assert content["provenance"]["made by"] == "poseloom fit flex-sensor"
    assert {each["from"] for each in content["figures"].values()} == {"data", "assumed"}
    other = FlexSensors(curvature=Spread(1.5, 0.2), loose=0.1)
    assert sensors_from_json(sensors_to_json(other, (), {})) == other
    for wrong in ("{}", "[]", "x", text.replace("0.213", '"a"')):
        with pytest.raises(FormatError):
            sensors_from_json(wrong)


def write(folder: Path, made: BendTable) -> Path:
    path = folder / f"{made.name}.csv"
    rows = np.concatenate([made.counts, 180 - np.degrees(made.bends)[:, None]], axis=1)
    np.savetxt(path, rows, "%.4f", ",", header=",".join((*made.channels, "angle")), comments="")
    return path


def test_the_command_writes_figures_and_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("a_1", "a_2"):
        write(tmp_path, table(name, [Shape(2.0, 0.05, 0.1, 1.0)] * 2, 50.0))
    figures, page = tmp_path / "figures.json", tmp_path / "page.html"
    assert run(["fit", "flex-sensor", str(tmp_path), "-o", str(figures), "--report", str(page)]) == 0
    assert sensors_from_json(figures.read_text()).curvature.median == pytest.approx(2.0, rel=0.15)
    assert "a_2, held back" in page.read_text()
    assert "held back, median counts" in capsys.readouterr().out
    assert run(["fit", "flex-sensor", str(tmp_path / "nothing"), "-o", str(figures)]) == 2


def test_tables_that_are_none_are_told_apart(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="no table"):
        read_bend_tables(tmp_path)
    path = write(tmp_path, table("a_1", [Shape(2.0, 0.05, 0.1, 1.0)]))
    (made,) = read_bend_tables(tmp_path)
    np.testing.assert_allclose(made.bends, bends(60.0, sum(map(ord, "a_1"))), atol=1e-5)
    lines = path.read_text().splitlines()
    lines[40] = "1,nan"
    path.write_text("\n".join(lines))
    with pytest.raises(FormatError, match=":41"):
        read_bend_tables(tmp_path)


def test_what_a_shift_on_the_joint_costs(tmp_path: Path) -> None:
    bent = np.round(np.degrees(bends(20.0, 1)), 3)
    rows = ["angle,r1,r2,r3,circular,lateral"]
    for lateral in (-1, 0, 1, 2):
        reaction = 1.5 * 0.9**lateral
        rows += [
            f"{180 - b},{700 + reaction * b},{650 + 2 * reaction * b},{600 + reaction * b},5,{lateral}" for b in bent
        ]
    (tmp_path / "displacement.csv").write_text("\n".join(rows))
    displaced = read_displaced_tables(tmp_path)
    assert sorted(displaced) == [(5.0, -1.0), (5.0, 0.0), (5.0, 1.0), (5.0, 2.0)]
    (lost,) = displacement_figures(displaced).values()
    assert lost == pytest.approx(0.1, abs=1e-3)
    assert read_displaced_tables(tmp_path / "elsewhere") == {}
    assert displacement_figures({}) == {}
    (tmp_path / "displacement.csv").write_text("angle,r1\n1,2\n")
    with pytest.raises(FormatError, match="circular"):
        read_displaced_tables(tmp_path)


def test_real_sensors_fit(recordings: Path) -> None:
    tables = read_bend_tables(recordings / "flex" / "elbow")
    assert len(tables) == 9
    fit = fit_channel(next(each for each in tables if each.name == "wcr_2"), 2)
    assert fit is not None
    assert fit.shape.curvature > 2.0  # bent sensors react more than straight ones
    assert np.nanmedian(np.abs(fit.residuals)) < 0.05
