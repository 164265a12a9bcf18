"""Fractal noise of the world: octaves of value noise over the level plane. Paper, supplement "Puddle Modeling"."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from reference_numpy.noise import value_noise
from reference_numpy.world import cells_of

Array = NDArray[np.float64]


def fbm(x: Array, z: Array, *, block: NDArray[np.int64], cells: int, weight: Array, seed: int) -> Array:
    """Sum over octaves o of weight[o] times value noise in cells of BLOCK / (cells 2^o) metres.

    Parameters
    ----------
    x, z
        (...) places [m] from the corner of the camera's block, along the world's level axes.
    block
        (3,) number of that block along x, y, z.
    cells
        Cells a block of the first octave.
    weight
        (octaves,) their weights.
    seed
        Of the first octave; each has its own.
    """
    total = np.zeros(np.shape(x))
    for o, share in enumerate(np.asarray(weight)):
        column, u = cells_of(x, block[0], cells << o)
        row, w = cells_of(z, block[2], cells << o)
        total += share * value_noise(column, row, u, w, seed + o)
    return total
