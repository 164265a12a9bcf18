"""Vehicles are solid: no depth from behind them where the laser went through glass or found nothing to answer."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

LENGTH_M = 5.0  # a car's surface lies within its own length
NEAR_SHARE = 20.0  # [%] of its pixels that are taken to see its near side


def solid_depth(depth: NDArray[np.float32], vehicle: NDArray[np.int32]) -> NDArray[np.float32]:
    """Depth with every vehicle closed.

    Parameters
    ----------
    depth
        (H, W) z [m].
    vehicle
        (H, W) instance ids, 0 = none.

    Returns
    -------
    NDArray[np.float32]
        (H, W) z [m]. Pixels of a vehicle that lie more than a car's length behind its near side take the depth of the
        vehicle's nearest pixel that does not; all others are as they were.
    """
    closed = depth.copy()
    for instance in np.unique(vehicle[vehicle > 0]):
        mask = vehicle == instance
        surface = mask & (depth < np.percentile(depth[mask], NEAR_SHARE) + LENGTH_M)
        rows, columns = distance_transform_edt(~surface, return_distances=False, return_indices=True)
        behind = mask & ~surface
        closed[behind] = depth[rows[behind], columns[behind]]
    return closed
