"""The nearest frames by running distances, against windows compared in full."""

import numpy as np
import pytest

from poseloom.methods.imus import _echo_kernels
from poseloom.methods.imus.echoes import echo_search
from poseloom.methods.imus.model import HmmModel

KEPT = 0.8


def examples() -> HmmModel:
    """A clip of two segments and one of one; what the search does not read is empty."""
    generator = np.random.default_rng(2)
    signals = (generator.normal(size=(60, 6)) * np.repeat([3.0, 0.5], 3)).astype(np.float32)
    whole = np.zeros(3, dtype=np.int64)
    return HmmModel(
        emissions=(),
        signals=signals,
        quats_wxyz=np.zeros((60, 1, 4), dtype=np.float32),
        others=np.zeros((60, 8), dtype=np.float32),
        ups=np.zeros((60, 1, 3), dtype=np.float32),
        maps=np.zeros(60, dtype=np.int64),
        gains=np.zeros((1, 7, 1), dtype=np.float32),
        variances=np.zeros((1, 7), dtype=np.float32),
        first=np.array([0, 15, 40]),
        stop=np.array([15, 40, 60]),
        phase_of_segment=whole,
        successor=np.array([1, -1, -1]),
        body_of_segment=whole,
        phase_of_state=np.zeros(60, dtype=np.int64),
        phase_names=("walking: rest",),
        phase_sizes=np.array([3]),
        entry=np.ones((1, 1)),
        bodies=np.zeros((1, 1)),
    )


def test_running_distances_are_those_of_windows() -> None:
    model, generator = examples(), np.random.default_rng(3)
    search = echo_search(model, KEPT, 4)
    assert np.flatnonzero(search.begins).tolist() == [0, 40]
    heard = generator.normal(size=(25, 6))
    echoes = search.none()
    for said in heard:
        echoes = search.heard(echoes, said)
    variance = model.signals.reshape(-1, 2, 3).var(axis=0).mean(axis=1)
    for i in (24, 39, 59):  # as many samples of their clips lie before them, or they end there
        back = min(len(heard), i + 1 if i < 40 else i - 39)
        apart = (heard[::-1][:back] - model.signals[i::-1][:back]).reshape(back, 2, 3)
        wanted = (KEPT ** np.arange(back) * (np.square(apart).sum(axis=2) / variance).sum(axis=1)).sum() / 6
        if back == len(heard):
            assert echoes.distances[i] == pytest.approx(wanted, rel=1e-3)
        else:
            # What lies before a clip counts as what its first frame was off at that time.
            assert echoes.distances[i] > wanted - 1e-4
            first = (heard[::-1][back:] - model.signals[i - back + 1]).reshape(-1, 2, 3)
            faded = KEPT ** np.arange(back, len(heard)) * (np.square(first).sum(axis=2) / variance).sum(axis=1)
            assert echoes.distances[i] == pytest.approx(wanted + faded.sum() / 6, rel=1e-3)
    assert echoes.weight == pytest.approx((1 - KEPT**25) / (1 - KEPT))


def test_a_stretch_of_an_example_finds_itself() -> None:
    model = examples()
    search = echo_search(model, KEPT, 3)
    echoes = search.none()
    for said in model.signals[18:33]:
        echoes = search.heard(echoes, said.astype(np.float64))
    rows, owners = search.nearest(echoes, np.zeros(3, dtype=np.float32))
    assert (rows[0], owners[0]) == (32, 1)
    # Somebody built otherwise is not asked.
    rows, owners = search.nearest(echoes, np.array([0.0, 99.0, 0.0], dtype=np.float32))
    assert 1 not in owners


@pytest.mark.parametrize("count", [1, 3, 100])
def test_the_least_come_first(count: int) -> None:
    generator = np.random.default_rng(count)
    distances = generator.random(60).astype(np.float32)
    strangeness = np.array([0.3, 0.0, 0.1], dtype=np.float32)
    first, stop = np.array([0, 15, 40]), np.array([15, 40, 60])
    rows, owners = np.empty(count, dtype=np.int64), np.empty(count, dtype=np.int64)
    found = _echo_kernels.nearest(distances, 0.5, strangeness, first, stop, rows, owners)
    costs = 0.5 * distances + np.repeat(strangeness, stop - first)
    assert found == min(count, 60)
    assert rows[:found].tolist() == np.argsort(costs, kind="stable")[:found].tolist()
    assert owners[:found].tolist() == np.repeat(np.arange(3), stop - first)[rows[:found]].tolist()
