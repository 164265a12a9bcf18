"""Means over blocks of rows, by which a step up the picture sees all that it passes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

BLOCKS = (3, 9, 27)  # [px] rows; each a multiple of the one before
LEAST_MEAN = 1e-6  # [1] share of things below which a mean is of none


class RowMeans:
    """Mean radiance of things over blocks of rows.

    Parameters
    ----------
    light
        (H, W, 3) radiance.
    solid
        (H, W) where there are things.
    """

    def __init__(self, light: Array, solid: NDArray[np.bool_]) -> None:
        things = np.concatenate([light, np.ones((*solid.shape, 1))], axis=-1) * solid[..., None]
        self.blocks = [_means(things, rows) for rows in BLOCKS]

    def around(self, y: Ints, x: Ints, stride: Ints, own: Array) -> Array:
        """Radiance around the middle of steps over rows y to y + stride, (M, 3); `own` where there is nothing."""
        out = own.copy()
        for i, rows in enumerate(BLOCKS):
            last = i == len(BLOCKS) - 1
            of = (stride > (BLOCKS[i - 1] if i else 1)) & ((stride <= rows) | last)
            above, weight = np.divmod(2 * y[of] + stride[of] - rows, 2 * rows)
            above, below = (np.clip(above + k, 0, len(self.blocks[i]) - 1) for k in (0, 1))
            upper, lower = (self.blocks[i][k, x[of]] for k in (above, below))
            block = upper + (weight / (2 * rows))[:, None] * (lower - upper)
            some = block[:, 3:] >= LEAST_MEAN
            out[of] = np.where(some, block[:, :3] / np.maximum(block[:, 3:], LEAST_MEAN), own[of])
        return out


def _means(values: Array, rows: int) -> Array:
    """Means of every so many rows, the last of what is left."""
    starts = np.arange(0, len(values), rows)
    counts = np.diff(starts, append=len(values))
    return np.asarray(np.add.reduceat(values, starts, axis=0) / counts[:, None, None])
