"""Edge-aware smoothing by alternating one-dimensional least squares: rows, columns, rows, ...

Source: Min, Choi, Lu, Ham, Sohn, Do, "Fast global image smoothing based on weighted least squares", IEEE TIP 2014.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_banded

Array = NDArray[np.float64]
ROUNDS = 3


def guide_weights(guide: NDArray[np.floating], sigma: float, axis: int) -> Array:
    """Affinity exp(-(difference / sigma)^2) of neighbours along `axis` of a guide image (H, W, C)."""
    return np.asarray(np.exp((np.diff(guide, axis=axis) ** 2).sum(axis=-1, dtype=np.float64) / -(sigma**2)))


def _solve_rows(values: Array, weights: Array) -> Array:
    """Minimise sum (x - values)^2 + sum weights (x_i+1 - x_i)^2 on every row; values (H, W, C), weights (H, W - 1).

    All rows make one tridiagonal system, uncoupled where a row ends: one call instead of H.
    """
    height, width, channels = values.shape
    coupling = np.zeros((height, width + 1))
    coupling[:, 1:-1] = weights
    after, before = coupling[:, 1:].ravel(), coupling[:, :-1].ravel()
    bands = np.zeros((3, height * width))
    bands[0, 1:] = -after[:-1]
    bands[1] = 1 + after + before
    bands[2, :-1] = -before[1:]
    flat = values.reshape(-1, channels)
    return np.asarray(solve_banded((1, 1), bands, flat, overwrite_ab=True, check_finite=False)).reshape(values.shape)


def smooth(values: Array, *, across: Array, down: Array) -> Array:
    """Smooth channels within the regions that the weights bound.

    Parameters
    ----------
    values
        (H, W, C).
    across
        (H, W - 1), smoothing strength between horizontal neighbours, >= 0; its root is about the reach [px].
    down
        (H - 1, W), the same between vertical neighbours.

    Returns
    -------
    NDArray[np.float64]
        (H, W, C). Constants stay as they are; a weight of 0 lets nothing through.
    """
    for step in range(ROUNDS):
        share = 1.5 * 4.0 ** (ROUNDS - 1 - step) / (4.0**ROUNDS - 1)  # Min et al. 2014, eq. 14
        values = _solve_rows(values, share * across)
        values = _solve_rows(np.swapaxes(values, 0, 1), share * down.T).swapaxes(0, 1)
    return values


def spread(values: Array, confidence: Array, *, across: Array, down: Array) -> tuple[Array, Array]:
    """Carry values from where they are known to everywhere (normalised smoothing).

    Parameters
    ----------
    values
        (H, W); read only where `confidence` is positive.
    confidence
        (H, W), >= 0.
    across, down
        As in `smooth`.

    Returns
    -------
    tuple
        (H, W) values, 0 where nothing arrives, and (H, W) how much confidence arrived there.
    """
    known = np.stack([np.where(confidence > 0, values * confidence, 0.0), confidence], axis=-1)
    total, weight = np.moveaxis(smooth(known, across=across, down=down), -1, 0)
    reached = weight > 1e-12
    return np.divide(total, weight, out=np.zeros_like(total), where=reached), weight
