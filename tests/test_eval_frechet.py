"""Frechet distance: closed forms, scipy's matrix root, and what must hold of every pair of sets."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.linalg import sqrtm

from eval.errors import MetricError
from eval.frechet import Statistics, distance, statistics

Array = NDArray[np.float64]


def features(n: int, d: int, *, seed: int, rank: int | None = None, scale: float = 1.0) -> Array:
    """Normal features around a random mean, in a random subspace of the given rank."""
    rng = np.random.default_rng(seed)
    rank = d if rank is None else rank
    mixed = rng.normal(size=(n, rank)) @ (rng.normal(size=(rank, d)) / np.sqrt(rank))
    return np.asarray(scale * (mixed + 0.3 * rng.normal(size=d)), dtype=np.float64)


def by_matrix_root(a: Array, b: Array) -> float:
    """The distance as it is printed, with scipy's root."""
    A, B = np.cov(a.T), np.cov(b.T)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that the product is singular
        root = sqrtm(A @ B).real
    return float(np.sum((a.mean(0) - b.mean(0)) ** 2) + np.trace(A) + np.trace(B) - 2 * np.trace(root))


@pytest.mark.parametrize(("n", "tolerance"), [(2048, 1e-6), (120, 1e-4)])
def test_equals_scipys_matrix_root(n: int, tolerance: float) -> None:
    a, b = features(n, 400, seed=1), features(n, 400, seed=2)
    expected = by_matrix_root(a, b)
    assert distance(a, b) == pytest.approx(expected, rel=tolerance)
    assert distance(statistics(a), statistics(b)) == pytest.approx(expected, rel=tolerance)


def test_of_diagonal_covariances_is_the_distance_of_deviations() -> None:
    """Of independent coordinates it is |m_a - m_b|^2 + |s_a - s_b|^2."""
    rng = np.random.default_rng(0)
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)  # uncorrelated
    (m_a, m_b), (s_a, s_b) = rng.normal(size=(2, 3)), rng.uniform(0.1, 3, size=(2, 3))
    found = distance(m_a + s_a * signs, m_b + s_b * signs)
    expected = np.sum((m_a - m_b) ** 2) + np.sum((s_a - s_b) ** 2) * 8 / 7  # variances are over N - 1
    assert found == pytest.approx(expected, rel=1e-12)


def test_of_sets_without_variance_is_the_distance_of_means() -> None:
    assert distance(np.zeros((5, 4)), np.full((3, 4), 2.0)) == 16


def test_samples_of_one_distribution_are_far_apart_where_they_are_few() -> None:
    """120 samples of 400 numbers: over half of the trace of 800, though the truth is 0."""
    rng = np.random.default_rng(0)
    few = distance(rng.normal(size=(120, 400)), rng.normal(size=(120, 400)))
    many = distance(rng.normal(size=(2048, 400)), rng.normal(size=(2048, 400)))
    assert few == pytest.approx(448.8, rel=0.01)
    assert many == pytest.approx(39.4, rel=0.01)


@settings(max_examples=200, deadline=None)
@given(st.integers(2, 40), st.integers(1, 40), st.integers(0, 2**32), st.floats(-6, 6))
def test_of_a_set_and_itself_is_zero_exactly(n: int, d: int, seed: int, magnitude: float) -> None:
    a = features(n, d, seed=seed, rank=1 + seed % min(n, d), scale=10**magnitude)
    shuffled = np.random.default_rng(seed).permutation(a)
    for b in (a, a.copy(), shuffled, statistics(a), statistics(shuffled)):
        assert distance(a, b) == 0
    assert distance(statistics(a), statistics(shuffled)) == 0


def test_is_never_negative_and_never_complex() -> None:
    rng = np.random.default_rng(0)
    for seed in range(1000):
        n, m = rng.integers(2, 30, 2)
        d = int(rng.integers(max(n, m), 60))  # both sets are rank-deficient
        a = features(n, d, seed=seed, scale=10 ** rng.uniform(-5, 5))
        b = a[rng.integers(0, n, m)] if seed % 2 else features(m, d, seed=seed + 1000)
        found = distance(a, b)
        assert type(found) is float
        assert 0 <= found < np.inf


@settings(max_examples=50, deadline=None)
@given(st.integers(2, 30), st.integers(2, 30), st.integers(1, 30), st.integers(0, 2**32))
def test_knows_no_order_and_no_frame_of_reference(n: int, m: int, d: int, seed: int) -> None:
    a, b = features(n, d, seed=seed), features(m, d, seed=seed + 1)
    found = distance(a, b)
    turned, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(d, d)))
    assert distance(b, a) == pytest.approx(found, rel=1e-9, abs=1e-9)
    assert distance(a @ turned + 5, b @ turned + 5) == pytest.approx(found, rel=1e-9, abs=1e-9)
    assert distance(3 * a, 3 * b) == pytest.approx(9 * found, rel=1e-9, abs=1e-9)


def test_small_distances_survive_large_means() -> None:
    """In float32, or as E[x^2] - E[x]^2, nothing of this would be left."""
    a = 1e6 + features(50, 4, seed=0)
    assert distance(a, a + 1e-3) == pytest.approx(4e-6, rel=1e-4)


def test_statistics_are_numpys() -> None:
    a = features(30, 7, seed=0)
    found = statistics(a)
    np.testing.assert_allclose(found.covariance, np.cov(a.T), rtol=1e-12)
    assert found.count == 30


@pytest.mark.parametrize(
    ("a", "message"),
    [
        (np.zeros(4), r"at least 2 features as \(N, d\), got shape \(4,\)"),
        (np.zeros((1, 4)), r"at least 2 features as \(N, d\), got shape \(1, 4\)"),
        (np.array([[1.0, 2.0], [1.0, np.nan]]), "NaN or infinity in row 1"),
        (np.zeros((2, 3)), "two sets of one length, got 3 and 2"),
    ],
)
def test_broken_features_are_refused(a: NDArray[Any], message: str) -> None:
    with pytest.raises(MetricError, match=message):
        distance(a, np.zeros((5, 2)))


@pytest.mark.parametrize(
    ("mean", "covariance", "count", "message"),
    [
        (np.zeros(2), np.zeros((3, 3)), 5, r"a mean \(d,\) and a covariance \(d, d\), got \(2,\) and \(3, 3\)"),
        (np.zeros(2), np.zeros((2, 2)), 1, "at least 2 features, got 1"),
        (np.zeros(2), np.full((2, 2), np.inf), 5, "finite"),
    ],
)
def test_broken_statistics_are_refused(mean: Array, covariance: Array, count: int, message: str) -> None:
    with pytest.raises(MetricError, match=message):
        Statistics(mean=mean, covariance=covariance, count=count)
