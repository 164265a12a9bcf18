"""Frechet distance of two sets of features, each taken for a normal distribution: no matrix root, never negative.

Dowson and Landau 1982; as a metric of generated pictures Heusel et al. 2017, of videos Unterthiner et al. 2019.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eval.errors import MetricError

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Statistics:
    """What the distance keeps of a set of features.

    Parameters
    ----------
    mean
        Mean of the features, (d,).
    covariance
        Their covariance, (d, d), over `count` - 1.
    count
        How many features there were, at least 2.

    Raises
    ------
    MetricError
        The shapes do not fit, a value is not finite, or `count` is below 2.
    """

    mean: Array
    covariance: Array
    count: int

    def __post_init__(self) -> None:
        d = np.size(self.mean)
        if np.shape(self.mean) != (d,) or np.shape(self.covariance) != (d, d):
            got = f"{np.shape(self.mean)} and {np.shape(self.covariance)}"
            raise MetricError(f"statistics: expected a mean (d,) and a covariance (d, d), got {got}")
        if self.count < 2:
            raise MetricError(f"statistics: expected those of at least 2 features, got {self.count}")
        if not (np.isfinite(self.mean).all() and np.isfinite(self.covariance).all()):
            raise MetricError("statistics: expected finite numbers, got NaN or infinity")


def check(features: NDArray[Any], name: str = "features") -> Array:
    """The features as float64 (N, d).

    Raises
    ------
    MetricError
        Not a table of at least two rows, or a row that is not finite.
    """
    table = np.asarray(features, dtype=np.float64)
    if table.ndim != 2 or table.shape[0] < 2 or table.shape[1] < 1:
        raise MetricError(f"{name}: expected at least 2 features as (N, d), got shape {table.shape}")
    broken = np.flatnonzero(~np.isfinite(table).all(axis=1))
    if broken.size:
        raise MetricError(f"{name}: expected finite numbers, got NaN or infinity in row {broken[0]}")
    return table


def statistics(features: NDArray[Any]) -> Statistics:
    """Mean and covariance of features (N, d): float64, in two passes, divided by N - 1.

    >>> statistics(np.array([[0.0, 0.0], [2.0, 4.0]])).covariance
    array([[2., 4.],
           [4., 8.]])
    """
    table = check(features)
    mean = table.mean(axis=0)
    centred = table - mean
    return Statistics(mean=mean, covariance=centred.T @ centred / (len(table) - 1), count=len(table))


def distance(a: NDArray[Any] | Statistics, b: NDArray[Any] | Statistics) -> float:
    """Squared Frechet distance of two normal distributions, given as features (N, d) or as their statistics.

    |m_a - m_b|^2 + tr A + tr B - 2 tr (A B)^(1/2), with covariances over N - 1. With factors F'F = A and G'G = B the
    last trace is the nuclear norm of F G', the sum of its singular values: there is no root of a matrix that may have
    none, the result is real, and it costs the smaller of N and d. Factors are the centred features themselves, or the
    eigenvectors of a stored covariance; where that has no full rank, the square root halves its digits (some 1e-7).

    Never negative; what the rounding of its own terms hides is 0, so a set and itself are at 0 exactly.

    >>> distance(np.array([[0.0], [2.0]]), np.array([[3.0], [5.0]]))  # one variance, means 3 apart
    9.0
    >>> round(distance(np.array([[-1.0], [1.0]]), np.array([[-3.0], [3.0]])), 12)  # deviations 2^.5 and 3 * 2^.5
    8.0

    Raises
    ------
    MetricError
        Features that are no finite table of two rows or more, or of two different lengths.
    """
    mean_a, F = _mean_and_factor(a)
    mean_b, G = _mean_and_factor(b)
    if len(mean_a) != len(mean_b):
        raise MetricError(
            f"features: expected two sets of one length, got {len(mean_a)} and {len(mean_b)} numbers each"
        )
    traces = np.vdot(F, F) + np.vdot(G, G)
    of_means = np.vdot(mean_a - mean_b, mean_a - mean_b)
    of_covariances = traces - 2 * np.linalg.svd(F @ G.T, compute_uv=False).sum()
    u = np.finfo(np.float64).eps * sum(F.shape)  # relative rounding of a sum over rows and columns
    rounding = u * traces + u**2 * (np.vdot(mean_a, mean_a) + np.vdot(mean_b, mean_b))
    found = float(of_means + of_covariances)
    return found if found > rounding else 0.0


def _mean_and_factor(of: NDArray[Any] | Statistics) -> tuple[Array, Array]:
    """Mean (d,) and a factor F (at most d, d) with F'F = covariance."""
    if isinstance(of, Statistics):
        values, vectors = np.linalg.eigh(of.covariance)
        return of.mean, np.sqrt(np.maximum(values, 0))[:, None] * vectors.T
    table = check(of)
    mean = table.mean(axis=0)
    F = (table - mean) / np.sqrt(len(table) - 1)
    if len(table) > table.shape[1]:  # then the triangle of F = QR is the smaller factor of the same covariance
        F = np.asarray(np.linalg.qr(F, mode="r"), dtype=np.float64)
    return mean, F
