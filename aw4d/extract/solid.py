"""Vehicles are solid and smooth: no depth from behind them where the laser went through glass or found no answer.

Black paint and glass answer to few beams, some of them at what they mirror. The surface is a membrane through the
returns that agree with it: a robust, smooth inverse depth over the vehicle's own pixels.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from aw4d.extract.smoothing import spread

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

LENGTH_M = 5.0  # a car's surface lies within its own length
NEAR_SHARE = 20.0  # [%] of its pixels that are taken to see its near side
REACH = 0.08  # of the membrane, as a share of the vehicle's height
ROUNDS = 3
AGREE = 0.03  # relative difference of inverse depth at which a pixel says little of the surface, at last
LEAST = 1e-3  # confidence that every pixel on the near side keeps


def _membrane(inverse: Array, mask: Mask, surface: Mask) -> Array:
    """Smooth inverse depth over the vehicle's pixels from those on its `surface`, fewer and fewer of them."""
    reach2 = max(2.0, REACH * mask.shape[0]) ** 2
    across, down = reach2 * (mask[:, 1:] & mask[:, :-1]), reach2 * (mask[1:] & mask[:-1])
    confidence = surface.astype(np.float64)
    for step in range(ROUNDS):
        fitted, _ = spread(inverse, confidence, across=across, down=down)
        tolerance = AGREE * 2.0 ** (ROUNDS - 1 - step)
        difference = np.where(fitted > 0, inverse / np.maximum(fitted, 1e-9) - 1, 0)
        confidence = np.where(surface, np.exp(-((difference / tolerance) ** 2)) + LEAST, 0.0)
    fitted, arrived = spread(inverse, confidence, across=across, down=down)
    return np.where(mask & (arrived > 0), fitted, inverse)


def solid_depth(depth: NDArray[np.float32], vehicle: NDArray[np.int32]) -> NDArray[np.float32]:
    """Depth with every vehicle closed and smooth.

    Parameters
    ----------
    depth
        (H, W) z [m].
    vehicle
        (H, W) instance ids, 0 = none.

    Returns
    -------
    NDArray[np.float32]
        (H, W) z [m]. A vehicle's pixels lie on one smooth surface through those of them that agree; what lies more than
        a car's length behind the near side does not count. All other pixels are as they were.
    """
    closed = depth.copy()
    for instance in np.unique(vehicle[vehicle > 0]):
        rows, columns = np.nonzero(vehicle == instance)
        window = np.s_[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
        mask, part = vehicle[window] == instance, depth[window]
        surface = mask & (part < np.percentile(part[mask], NEAR_SHARE) + LENGTH_M)
        fitted = _membrane(1 / part.astype(np.float64), mask, surface)
        closed[window][mask] = (1 / fitted[mask]).astype(np.float32)
    return closed
