"""The HMM's forward step against enumeration, and against hmmlearn."""

import itertools

import numpy as np
import pytest

from poseloom.methods.imus import _forward_kernels as kernels

STEPS = np.array([0.25, 0.5, 0.25])
CONTINUITY = 0.3


class Small:
    """Two phases, three segments, seven states; two columns."""

    first = np.array([0, 3, 5])
    stop = np.array([3, 5, 7])
    phase = np.array([0, 1, 0])
    successor = np.array([1, -1, 0])
    sizes = np.array([2, 1])
    entry = np.array([[0.2, 0.8], [0.9, 0.1]])

    def __init__(self, seed: int = 0) -> None:
        draw = np.random.default_rng(seed)
        self.features = draw.normal(size=(7, 5)).astype(np.float32)
        self.precision = draw.uniform(0.5, 2.0, size=(2, 5)).astype(np.float32)
        self.log_norm = 0.5 * np.log(self.precision / (2 * np.pi)).sum(axis=1).astype(np.float64)
        self.seen = draw.normal(size=(4, 5)).astype(np.float32)
        self.log_weight = draw.normal(size=3)

    def transitions(self) -> np.ndarray:
        """The seven states' transition matrix, written out by hand from the rules."""
        matrix = np.zeros((7, 7))
        for s in range(3):
            for i in range(self.first[s], self.stop[s]):
                matrix[i, i] += STEPS[0]
                for hop, share in ((1, STEPS[1]), (2, STEPS[2])):
                    if i + hop < self.stop[s]:
                        matrix[i, i + hop] += share
                        continue
                    left = share
                    if self.successor[s] >= 0:
                        matrix[i, self.first[self.successor[s]]] += CONTINUITY * share
                        left *= 1 - CONTINUITY
                    for other in range(3):
                        p = self.phase[other]
                        matrix[i, self.first[other]] += left * self.entry[self.phase[s], p] / self.sizes[p]
        return matrix

    def emission(self, t: int) -> np.ndarray:
        owner = np.repeat(np.arange(3), self.stop - self.first)
        precision = self.precision[self.phase[owner]]
        apart = (precision * (self.seen[t] - self.features) ** 2).sum(axis=1)
        return np.exp(-0.5 * apart + self.log_norm[self.phase[owner]] + self.log_weight[owner])

    def step(self, predicted: np.ndarray, t: int, beam: float = 700.0, restart: float = 0.0, stride: int = 1) -> tuple:
        log_alpha = np.empty(7)
        evidence = kernels.update(
            predicted, self.features, self.precision, self.log_norm, self.log_weight, self.first, self.stop,
            self.phase, self.seen[t], restart, stride, 0, beam, log_alpha,
        )  # fmt: skip
        return log_alpha, evidence

    def predict(self, log_alpha: np.ndarray) -> np.ndarray:
        predicted = np.empty(7)
        kernels.predict(
            log_alpha, self.first, self.stop, self.phase, self.successor, self.entry, self.sizes, STEPS, CONTINUITY,
            predicted,
        )  # fmt: skip
        return predicted


def test_the_forward_step_sums_over_all_paths() -> None:
    model = Small()
    matrix = model.transitions()
    np.testing.assert_allclose(matrix.sum(axis=1), 1)
    log_alpha, evidence = model.step(np.full(7, 1 / 7), 0)
    total = evidence
    for t in range(1, 4):
        log_alpha, evidence = model.step(model.predict(log_alpha), t)
        total += evidence
    by_end = np.zeros(7)
    emissions = [model.emission(t) for t in range(4)]
    for path in itertools.product(range(7), repeat=4):
        p = emissions[0][path[0]] / 7
        for t in range(1, 4):
            p *= matrix[path[t - 1], path[t]] * emissions[t][path[t]]
        by_end[path[-1]] += p
    np.testing.assert_allclose(np.exp(log_alpha), by_end / by_end.sum(), rtol=1e-4, atol=1e-9)
    assert total == pytest.approx(np.log(by_end.sum()), rel=1e-5)
    assert np.exp(log_alpha).sum() == pytest.approx(1)


def test_a_flat_model_is_hmmlearns() -> None:
    GaussianHMM = pytest.importorskip("hmmlearn.hmm", reason="hmmlearn has no wheel for this Python").GaussianHMM

    draw = np.random.default_rng(3)
    states, columns = 6, 4
    means = draw.normal(size=(states, columns)).astype(np.float32)
    seen = draw.normal(size=(12, columns)).astype(np.float32)
    # Every state a segment of its own and a phase of its own: leaving is the one way on.
    single = np.arange(states)
    entry = draw.dirichlet(np.ones(states), size=states)
    precision = np.ones((states, columns), dtype=np.float32)
    norm = 0.5 * np.log(precision / (2 * np.pi)).sum(axis=1).astype(np.float64)
    stay = np.array([0.4, 0.5, 0.1])
    oracle = GaussianHMM(n_components=states, covariance_type="diag")
    oracle.startprob_ = np.full(states, 1 / states)
    oracle.transmat_ = 0.4 * np.eye(states) + 0.6 * entry
    oracle.means_ = means.astype(np.float64)
    oracle.covars_ = np.ones((states, columns))
    predicted, log_alpha, total = np.full(states, 1 / states), np.empty(states), 0.0
    for t in range(len(seen)):
        if t:
            kernels.predict(
                log_alpha, single, single + 1, single, np.full(states, -1), entry, np.ones(states, dtype=np.int64),
                stay, 0.0, predicted,
            )  # fmt: skip
        total += kernels.update(
            predicted, means, precision, norm, np.zeros(states), single, single + 1, single, seen[t], 0.0, 1, 0,
            700.0, log_alpha,
        )  # fmt: skip
    assert total == pytest.approx(oracle.score(seen.astype(np.float64)), rel=1e-5)
    # The posterior of the last sample needs no later one: smoothing and filtering agree there.
    np.testing.assert_allclose(
        np.exp(log_alpha), oracle.predict_proba(seen.astype(np.float64))[-1], rtol=1e-4, atol=1e-7
    )


def test_the_beam_drops_only_what_is_below_it() -> None:
    model = Small(1)
    whole, _ = model.step(np.full(7, 1 / 7), 0)
    beam = 0.5 * (whole.max() - whole.min())
    pruned, _ = model.step(np.full(7, 1 / 7), 0, beam)
    kept = np.isfinite(pruned)
    np.testing.assert_array_equal(kept, whole >= whole.max() - beam)
    assert 0 < kept.sum() < 7
    assert np.exp(pruned[kept]).sum() == pytest.approx(1)
    np.testing.assert_allclose(np.diff(pruned[kept]), np.diff(whole[kept]))


def test_every_stride_th_state_is_entered_from_nowhere() -> None:
    model = Small(2)
    nowhere = np.zeros(7)
    reached, _ = model.step(nowhere, 0, restart=0.5, stride=3)
    np.testing.assert_array_equal(np.flatnonzero(np.isfinite(reached)), [0, 3, 6])
    everywhere, _ = model.step(nowhere, 0, restart=0.5, stride=1)
    expected = model.emission(0) / model.emission(0).sum()
    np.testing.assert_allclose(np.exp(everywhere), expected, rtol=1e-4)


def test_silence_keeps_the_prediction() -> None:
    model = Small(3)
    log_alpha, _ = model.step(np.full(7, 1 / 7), 0)
    predicted = model.predict(log_alpha)
    settled = np.empty(7)
    kernels.settle(predicted, 700.0, settled)
    np.testing.assert_allclose(np.exp(settled), predicted / predicted.sum(), rtol=1e-12)


def test_the_best_segments_come_in_their_order_with_their_places() -> None:
    model = Small(4)
    log_alpha, _ = model.step(np.full(7, 1 / 7), 0)
    alpha = np.exp(log_alpha)
    chosen, mass, place = np.empty(2, dtype=np.int64), np.empty(2), np.empty(2)
    everywhere = np.ones(2, dtype=np.bool_)
    count = kernels.best_segments(log_alpha, model.first, model.stop, model.phase, everywhere, 99, chosen, mass, place)
    masses = np.array([alpha[a:b].sum() for a, b in zip(model.first, model.stop, strict=True)])
    assert count == 2
    np.testing.assert_array_equal(chosen, np.argsort(-masses)[:2])
    np.testing.assert_allclose(mass, np.sort(masses)[::-1][:2])
    for segment, at in zip(chosen, place, strict=True):
        inside = np.arange(model.first[segment], model.stop[segment])
        assert at == pytest.approx((alpha[inside] * inside).sum() / alpha[inside].sum())
    count = kernels.best_segments(
        log_alpha, model.first, model.stop, model.phase, np.array([False, True]), 99, chosen, mass, place
    )
    assert count == 1
    assert chosen[0] == 1


def test_a_segment_that_is_likely_at_two_places_is_taken_at_one() -> None:
    log_alpha = np.log(np.array([0.3, 0.1, 0.01, 0.01, 0.01, 0.17, 0.4]))
    chosen, mass, place = np.empty(1, dtype=np.int64), np.empty(1), np.empty(1)
    one = np.array([0]), np.array([7]), np.array([0]), np.ones(1, dtype=np.bool_)
    assert kernels.best_segments(log_alpha, *one, 1, chosen, mass, place) == 1
    assert mass[0] == pytest.approx(0.57)
    assert place[0] == pytest.approx((5 * 0.17 + 6 * 0.4) / 0.57)


@pytest.mark.parametrize("least", [1.0, 2.0, 3.9])
def test_weights_are_evened_out_no_more_than_asked(least: float) -> None:
    mass = np.array([0.97, 0.02, 0.008, 0.0019, 0.0001])
    weights = np.empty(5)
    power = kernels.even_out(mass, least, weights)
    np.testing.assert_allclose(weights, mass**power / (mass**power).sum())
    effective = 1 / (weights**2).sum()
    assert power == 1.0 if least == 1.0 else effective == pytest.approx(least, rel=1e-3)
    even = np.full(5, 0.2)
    assert kernels.even_out(even, least, weights) == 1.0
    np.testing.assert_allclose(weights, even)
