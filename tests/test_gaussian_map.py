"""The multivariate Gaussian map."""

import numpy as np
import pytest

from poseloom.errors import MethodError
from poseloom.methods.imus.gaussian_map import fit_gaussian_map


def examples(count: int = 400) -> tuple[np.ndarray, np.ndarray]:
    draw = np.random.default_rng(4)
    y = draw.normal(size=(count, 3)) @ draw.normal(size=(3, 3)) + 2.0
    return y @ draw.normal(size=(3, 5)) + 0.3 * draw.normal(size=(count, 5)) - 1.0, y


def test_without_shrinkage_it_is_the_closed_form() -> None:
    x, y = examples()
    both = np.cov(np.concatenate([x, y], axis=1).T, bias=True)
    xx, xy, yy = both[:5, :5], both[:5, 5:], both[5:, 5:]
    found = fit_gaussian_map(x, y, 0.0)
    np.testing.assert_allclose(found.gain, xy @ np.linalg.inv(yy), rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(found.variance, np.diag(xx - xy @ np.linalg.inv(yy) @ xy.T), rtol=1e-6)
    asked = np.array([1.0, 2.0, 3.0])
    expected = x.mean(axis=0) + xy @ np.linalg.solve(yy, asked - y.mean(axis=0))
    np.testing.assert_allclose(found.given(asked), expected, rtol=1e-6)


def test_it_is_least_squares_without_shrinkage() -> None:
    x, y = examples()
    design = np.concatenate([y, np.ones((len(y), 1))], axis=1)
    fitted = np.linalg.lstsq(design, x, rcond=None)[0]
    found = fit_gaussian_map(x, y, 0.0)
    np.testing.assert_allclose(found.gain, fitted[:3].T, rtol=1e-5, atol=1e-7)


def test_shrinkage_is_a_convex_mixture_of_covariances() -> None:
    x, y = examples()
    s = 0.4
    both = np.cov(np.concatenate([x, y], axis=1).T, bias=True)
    yy = (1 - s) * both[5:, 5:] + s * np.trace(both[5:, 5:]) / 3 * np.eye(3)
    found = fit_gaussian_map(x, y, s)
    np.testing.assert_allclose(found.gain, (1 - s) * both[:5, 5:] @ np.linalg.inv(yy), rtol=1e-6, atol=1e-8)
    none = fit_gaussian_map(x, y, 1.0)
    np.testing.assert_allclose(none.gain, 0, atol=1e-9)
    np.testing.assert_allclose(none.variance, x.var(axis=0), rtol=1e-6)


def test_fewer_examples_than_channels_can_be_solved() -> None:
    x, y = examples(2)
    found = fit_gaussian_map(x, y, 0.3)
    assert np.isfinite(found.gain).all()
    alone = fit_gaussian_map(x[:1], y[:1], 0.3)
    np.testing.assert_allclose(alone.gain, 0)
    np.testing.assert_allclose(alone.given(y[1]), x[0])


def test_weights_count_as_repetitions() -> None:
    x, y = examples(20)
    weights = np.arange(20) % 3 + 1.0
    repeated = np.repeat(np.arange(20), weights.astype(int))
    weighted, plain = fit_gaussian_map(x, y, 0.2, weights), fit_gaussian_map(x[repeated], y[repeated], 0.2)
    np.testing.assert_allclose(weighted.gain, plain.gain, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(weighted.variance, plain.variance, rtol=1e-9)


def test_nonsense_is_refused() -> None:
    x, y = examples(3)
    with pytest.raises(MethodError, match="no Gaussian"):
        fit_gaussian_map(x[:0], y[:0], 0.1)
    with pytest.raises(MethodError, match="shrinkage"):
        fit_gaussian_map(x, y, 1.5)
