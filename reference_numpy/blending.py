"""Particles before a picture, from the nearest to the farthest.

They are blended in the order of their depth; a place in that order, and all that follows from an order, is taken from
a depth rounded to float32, which every device finds alike.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from reference_numpy.capsules import Capsules
from reference_numpy.ramps import smoothstep

Array = NDArray[np.float64]

KEYS = 2**16  # steps of depth by which particles are put in order
BEHIND = 0.01  # share of the surface's depth over which a particle sinks into it
COVERED = 4.0  # slope of the step at half of a pixel that is covered


def in_order(depth: NDArray[np.float32], steps: float) -> NDArray[np.int64]:
    """Numbers of particles from the nearest to the farthest, those of one of the `steps` a metre by their number."""
    key = np.minimum(depth * np.float32(steps), np.float32(KEYS - 1)).astype(np.uint32)
    return np.argsort(key, kind="stable")


def blend(
    drops: Capsules, color: Array, *, rgb: Array, depth: Array, sky: NDArray[np.bool_]
) -> tuple[Array, Array, Array]:
    """Particles, from the nearest to the farthest, before a picture.

    Parameters
    ----------
    drops, color
        Particles in order, and their colours, (N, 3).
    rgb, depth, sky
        The picture, (H, W, 3), (H, W) z of its surfaces [m], (H, W) True where there is none.

    Returns
    -------
    rgb, alpha, depth
        (H, W, 3); (H, W) share that particles hide; (H, W) depth of the nearest particle that covers half of the pixel,
        or of the surface [m].
    """
    height, width = depth.shape
    light, alpha = np.zeros((height, width, 3)), np.zeros((height, width))
    taken, log_nearest = np.zeros((height, width)), np.zeros((height, width))
    surface = np.where(sky, np.inf, np.maximum(depth, 1e-3))
    for i in range(len(color)):
        ends, wide = np.stack([drops.head[i], drops.tail[i]]), max(drops.head_radius[i], drops.tail_radius[i])
        first = np.maximum(np.floor(ends.min(axis=0) - wide), 0).astype(int)
        last = np.minimum(np.ceil(ends.max(axis=0) + wide), (width - 1, height - 1)).astype(int)
        if (last < first).any():
            continue
        at = np.s_[first[1] : last[1] + 1, first[0] : last[0] + 1]
        v, u = np.mgrid[at]
        z = float(drops.depth[i])
        shows = _profile(drops, i, u, v) * smoothstep(0.0, 1.0, (1 - z / surface[at]) / BEHIND)
        a = drops.opacity[i] * shows
        covers = np.clip((drops.covers[i] * shows - 0.5) * COVERED + 0.5, 0.0, 1.0)
        left = (1 - alpha[at]) * a
        light[at] += left[..., None] * color[i]
        alpha[at] += left
        log_nearest[at] += (1 - taken[at]) * covers * np.log(z)
        taken[at] += (1 - taken[at]) * covers
    # Where half of a pixel is just about covered, the depth is between the two, by its logarithm.
    between = np.exp(log_nearest + (1 - taken) * np.log(np.where((taken > 0) & (taken < 1), depth, 1.0)))
    return light + (1 - alpha)[..., None] * rgb, alpha, np.where(taken > 0, between, depth)


def _profile(drops: Capsules, i: int, u: NDArray[np.int64], v: NDArray[np.int64]) -> Array:
    """(1 - (d / rho)^2)^4 of pixels, d being the distance to the axis and rho the radius beside it."""
    from_head = np.stack([u - drops.head[i, 0], v - drops.head[i, 1]], axis=-1)
    axis = drops.tail[i] - drops.head[i]
    along = np.clip(from_head @ axis / max(float(axis @ axis), 1e-30), 0.0, 1.0)
    off = from_head - along[..., None] * axis
    rho = drops.head_radius[i] + along * (drops.tail_radius[i] - drops.head_radius[i])
    out: Array = np.maximum(1 - (off**2).sum(axis=-1) / rho**2, 0.0) ** 4
    return out
