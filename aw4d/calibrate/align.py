"""Scale and bias that turn a sequence's relative depth into metres, from sparse laser depth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aw4d.errors import InputError

Array = NDArray[np.float64]

PAIRS = 1000  # pairs that the fit sees
HYPOTHESES = 3000  # lines tried: finds two inliers with probability 1 - 1e-13 where 90 % are outliers
TOLERANCE = 0.05  # largest deviation of an inlier, as a fraction of its metric depth
FEWEST = 10  # pairs under which a line is not believed


@dataclass(frozen=True, kw_only=True)
class Alignment:
    """metric = scale * relative + bias.

    Parameters
    ----------
    scale
        Metres in one unit of relative depth, positive.
    bias
        [m].
    inliers
        Sampled pairs that lie on the line within 5 %.
    rmse
        Root mean square deviation of the inliers [m].
    pairs
        Sampled pairs.
    """

    scale: float
    bias: float
    inliers: int
    rmse: float
    pairs: int


def _valid_pairs(relative: ArrayLike, metric: ArrayLike) -> tuple[Array, Array]:
    x, y = np.asarray(relative, dtype=np.float64), np.asarray(metric, dtype=np.float64)
    if x.shape != y.shape:
        raise InputError(f"align_depth: expected relative and metric depth of one shape, got {x.shape} and {y.shape}")
    valid = np.isfinite(x) & np.isfinite(y) & (x > 0) & (y > 0)
    x, y = x[valid], y[valid]
    if len(x) < FEWEST:
        raise InputError(f"align_depth: expected at least {FEWEST} pairs of valid depth, got {len(x)} of {valid.size}")
    for name, depth in (("relative", x), ("metric", y)):
        if np.ptp(depth) <= 1e-9 * depth.max():
            raise InputError(f"align_depth: expected {name} depth that varies, got {depth[0]:g} on every pair")
    return x, y


def _fit_line(x: Array, y: Array) -> tuple[float, float]:
    """Least squares in centred coordinates, where the normal equations of far, narrow data stay well conditioned."""
    mean_x, mean_y = x.mean(), y.mean()
    variance = np.square(x - mean_x).sum()
    scale = float(((x - mean_x) * (y - mean_y)).sum() / variance) if variance > 0 else 0.0
    return scale, float(mean_y - scale * mean_x)


def _consensus(x: Array, y: Array, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Inliers of the line through two pairs that most pairs agree with (Fischler and Bolles 1981)."""
    first, second = rng.integers(len(x), size=(2, HYPOTHESES))
    distinct = x[first] != x[second]
    first, second = first[distinct], second[distinct]
    slope = (y[second] - y[first]) / (x[second] - x[first])
    best, most = np.zeros(len(x), dtype=np.bool_), -1
    for s, x0, y0 in zip(slope, x[first], y[first], strict=True):
        agrees = np.abs(y0 + s * (x - x0) - y) <= TOLERANCE * y
        count = int(np.count_nonzero(agrees))
        if count > most:
            best, most = agrees, count
    return best


def align_depth(relative: ArrayLike, metric: ArrayLike, *, seed: int) -> Alignment:
    """Fit scale and bias of relative depth to metric depth, robustly; one pair for a whole sequence.

    1000 sampled pairs, RANSAC, then least squares on the inliers until they no longer change.

    Parameters
    ----------
    relative
        Relative depth, any shape. Pairs with a value that is not finite or not positive are left out.
    metric
        Laser depth [m] of the same pixels, the same shape; zero means no return.
    seed
        Of the sampling.

    Raises
    ------
    InputError
        Fewer than 10 pairs are valid or agree, a depth is constant, or the depths run against each other.
    """
    x, y = _valid_pairs(relative, metric)
    rng = np.random.default_rng(seed)
    if len(x) > PAIRS:
        chosen = rng.choice(len(x), PAIRS, replace=False)
        x, y = x[chosen], y[chosen]
    inlier = _consensus(x, y, rng)
    for _ in range(10):
        scale, bias = _fit_line(x[inlier], y[inlier])
        again = np.abs(scale * x + bias - y) <= TOLERANCE * y
        if np.array_equal(again, inlier) or np.count_nonzero(again) < FEWEST:
            break
        inlier = again
    count = int(np.count_nonzero(inlier))
    if count < FEWEST:
        raise InputError(f"align_depth: expected at least {FEWEST} pairs on one line, got {count} of {len(x)}")
    if scale <= 0:
        raise InputError(f"align_depth: expected metric depth that grows with relative depth, got scale {scale:g}")
    rmse = float(np.sqrt(np.mean(np.square(scale * x[inlier] + bias - y[inlier]))))
    return Alignment(scale=scale, bias=bias, inliers=count, rmse=rmse, pairs=len(x))
