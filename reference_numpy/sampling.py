"""Quadrature and distances along a camera's rays."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@lru_cache(maxsize=16)
def gauss_legendre(nodes: int) -> tuple[Array, Array]:
    """Abscissae and weights of Gauss-Legendre quadrature on [-1, 1], (nodes,) each; nobody can write to them."""
    x, w = np.polynomial.legendre.leggauss(nodes)
    x.flags.writeable = w.flags.writeable = False
    return x, w


def rays(shape: tuple[int, int], *, fx: float, fy: float, cx: float, cy: float) -> tuple[Array, Array]:
    """Unit ray through every pixel centre and its stretch, range over depth.

    Parameters
    ----------
    shape
        (H, W).
    fx, fy, cx, cy
        Pinhole intrinsics [px].

    Returns
    -------
    direction, stretch
        (H, W, 3) unit, camera frame, and (H, W), >= 1.
    """
    height, width = shape
    u, v = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
    ray = np.stack([(u - cx) / fx, (v - cy) / fy, np.ones(shape)], axis=-1)
    stretch = np.sqrt(np.einsum("...c,...c->...", ray, ray))
    return ray / stretch[..., None], stretch


def path_length(depth: ArrayLike, sky: ArrayLike, stretch: ArrayLike, *, extent_m: float) -> Array:
    """Distance that a ray travels through the medium [m], (H, W).

    The range of the surface, but no more than `extent_m`, which is also the path to the sky: an endless medium would
    hide the sky however thin it is.
    """
    s = np.minimum(np.asarray(depth, dtype=np.float64) * np.asarray(stretch), extent_m)
    return np.where(np.asarray(sky), extent_m, s)
