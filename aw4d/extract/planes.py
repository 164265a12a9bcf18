"""Local planes of an inverse depth map.

Over the image a plane has linear inverse depth, 1/z = a x + b y + c with ray (x, y, 1), and (a, b, c) is its normal
over its distance from the eye. On a plane of any slant the three parameters are constant, so they can be averaged
over windows of any shape, cut off at edges, without bending it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STEP = 0.01  # relative bend of inverse depth over one pixel that separates surfaces


def affinity(inverse: Array, axis: int) -> Array:
    """Affinity of neighbours along `axis`, 0 to 1: low where inverse depth is not linear from one to the next."""
    q = np.moveaxis(inverse, axis, 0)
    bend = np.zeros_like(q)
    bend[1:-1] = np.abs(q[2:] - 2 * q[1:-1] + q[:-2]) / q[1:-1]
    weight = np.exp(-((np.minimum(bend[1:], bend[:-1]) / STEP) ** 2))
    return np.moveaxis(weight, 0, axis)


def _slope(inverse: Array, alike: Array, axis: int) -> tuple[Array, Array]:
    """Derivative of inverse depth per pixel along `axis`, and the smaller affinity to the two neighbours."""
    q, w = np.moveaxis(inverse, axis, 0), np.moveaxis(alike, axis, 0)
    if len(q) == 1:
        return np.zeros_like(inverse), np.ones_like(inverse)
    step = np.pad(np.diff(q, axis=0), ((1, 1), (0, 0)), mode="edge")
    w = np.pad(w, ((1, 1), (0, 0)), mode="edge")
    slope, trust = (step[1:] + step[:-1]) / 2, np.minimum(w[1:], w[:-1])
    return np.moveaxis(slope, 0, axis), np.moveaxis(trust, 0, axis)


def local_planes(inverse: Array, rays: Array, focal: Array, *, across: Array, down: Array) -> tuple[Array, Array]:
    """Plane (a, b, c) through every pixel, (H, W, 3), and how far it is to be trusted, (H, W), 0 to 1."""
    a, trust_a = _slope(inverse, across, 1)
    b, trust_b = _slope(inverse, down, 0)
    a, b = a * focal[0], b * focal[1]
    return np.stack([a, b, inverse - a * rays[..., 0] - b * rays[..., 1]], axis=-1), np.minimum(trust_a, trust_b)
