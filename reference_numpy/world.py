"""Where surfaces lie in the world, exactly enough for its noise: blocks of `BLOCK` metres, and cells within them.

A world may lie a million metres from its origin, where a float32 counts in tenths of metres. So the camera's place
comes as the integer number of the block that it is in and metres from that block's corner; a lattice has a whole
number of cells a block, and a cell's number is block x cells + the cell within the block: integers, exact anywhere.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from reference_numpy.sampling import rays

Array = NDArray[np.float64]
Cells = NDArray[np.int64]

BLOCK = 160.0  # [m] a side; many cell sizes go into it a whole number of times


def places(
    depth: Array,
    *,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    to_world: Array,
    to_world_lo: Array,
    eye: Array,
    eye_lo: Array,
) -> Array:
    """Places of surfaces [m], (H, W, 3), from the corner of the camera's block, along the world's axes.

    Parameters
    ----------
    depth
        (H, W) z of the surfaces [m].
    fx, fy, cx, cy
        Intrinsics [px].
    to_world, to_world_lo
        (9,) rotation from camera to world, row after row, and what rounding took off it.
    eye, eye_lo
        (3,) the camera's place in its block [m], and what rounding took off it.
    """
    ray, stretch = rays(depth.shape, fx=fx, fy=fy, cx=cx, cy=cy)
    point = ray * (stretch * depth)[..., None]
    R = (np.asarray(to_world) + np.asarray(to_world_lo)).reshape(3, 3)
    out: Array = point @ R.T + (np.asarray(eye) + np.asarray(eye_lo))
    return out


def cells_of(place: Array, block: int | NDArray[np.int64], cells: int) -> tuple[Cells, Array]:
    """Numbers of the cells, `cells` a block, that one coordinate of places lies in, and how far into them, 0 to 1.

    Parameters
    ----------
    place
        (...) one coordinate [m], from the corner of the camera's block.
    block
        Number of that block along this axis.
    cells
        Cells a block; they are BLOCK / cells metres wide.
    """
    at = place * (cells / BLOCK)
    first = np.floor(at)
    return first.astype(np.int64) + int(block) * cells, at - first
