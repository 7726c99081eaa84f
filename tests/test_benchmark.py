"""The benchmark's tools; what they measure is not judged here."""

import pytest

from poseloom.benchmark.core import Measurement, bvh_time, kinematics_time
from poseloom.benchmark.pages import core_page, core_results, shown
from poseloom.benchmark.timing import Timing, time_calls, timing_of
from poseloom.cli._app import run


def test_a_timing_is_the_median_with_least_and_most():
    assert timing_of([3.0, 1.0, 2.0, 9.0]) == Timing(2.5, 1.0, 9.0, 4)


def test_calls_are_counted_and_the_first_does_not_count():
    calls: list[int] = []
    timing = time_calls(lambda: calls.append(1), repeats=3, calls_each=4)
    assert len(calls) == 13
    assert timing.repeats == 3
    assert 0 <= timing.least <= timing.median <= timing.most


def test_a_page_and_rows_hold_every_figure():
    measured = [Measurement("step", "10 poses", 2e-3, Timing(1.5e-3, 1e-3, 4e-3, 7))]
    assert shown(measured[0]) == ("step", "10 poses", "1.5 ms", "1 ms", "4 ms", "7", "2 ms")
    assert "| step | 10 poses | 1.5 ms | 1 ms | 4 ms | 7 | 2 ms |" in core_page(measured)
    rows = {row.metric: row.value for row in core_results(measured).rows}
    assert rows == {"median_s": 1.5e-3, "least_s": 1e-3, "most_s": 4e-3, "bound_s": 2e-3}


@pytest.mark.parametrize("measure", [kinematics_time, bvh_time])
def test_a_measurement_is_finite(measure):
    assert 0 < measure().timing.median < 60


def test_data_that_is_not_there(tmp_path, capsys):
    assert run(["benchmark", "core", "--data", str(tmp_path / "none")]) == 2
    assert "no such folder" in capsys.readouterr().err
