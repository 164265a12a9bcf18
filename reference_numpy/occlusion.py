"""Ambient occlusion: the share of its surroundings that a surface sees past what the picture shows near it.

Horizon-based (Jimenez et al. 2016): the half space above the surface is cut into slices that hold the view direction,
and in each one the highest thing on both sides bounds what is seen; the cosine-weighted arc between has a closed form.
The samples lie on a fixed pattern of whole pixels, the same for every pixel and frame, so that nothing swims and no
lookup needs rounding; and the arcs of an open half space are divided out, so that a plane comes out at exactly 1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Slices, as pixels to go a step: the first two, four or all eight are evenly spread.
DIRECTIONS = ((1, 0), (0, 1), (1, 1), (-1, 1), (2, 1), (-1, 2), (1, 2), (-2, 1))
FIRST = 2  # [px] the nearest sample at a focal length below 1536 px; every further one is twice as far
MIN_NOV = 1e-3
SOFTENING_M = 1e-6  # of distances, so that none is 0; a sum, as in the kernel: a millimetre away it shows


def reach_scale(fx: float) -> int:
    """Factor on the pattern, so that it covers the same angle in large pictures."""
    return max(1, int(fx / 1024 + 0.5))


def ambient_occlusion(
    *,
    depth: Array,
    sky: NDArray[np.bool_],
    normal: Array,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    occlusion_radius_m: float,
    occlusion_slices: int,
    occlusion_steps: int,
) -> Array:
    """Share of the surroundings that a surface sees, (H, W), 0 to 1; 1 in the sky.

    Parameters
    ----------
    depth, sky, normal
        (H, W) [m], (H, W), and (H, W, 3) unit, camera frame.
    fx, fy, cx, cy
        Intrinsics [px].
    occlusion_radius_m
        Distance beyond which nothing occludes [m].
    occlusion_slices, occlusion_steps
        Slices, and samples on each side of each.
    """
    height, width = depth.shape
    u, v = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
    ray = np.stack([(u - cx) / fx, (v - cy) / fy, np.ones(depth.shape)], axis=-1)
    stretch = np.linalg.norm(ray, axis=-1)
    seen, open_ = np.zeros(depth.shape), np.zeros(depth.shape)
    scale = reach_scale(fx)
    for du, dv in DIRECTIONS[:occlusion_slices]:
        way = np.array([du / fx, dv / fy, 0.0])
        across = way - (ray @ way / stretch**2)[..., None] * ray
        tangent = across / np.linalg.norm(across, axis=-1, keepdims=True)
        n_t = np.einsum("...c,...c->...", normal, tangent)
        n_v = np.maximum(-np.einsum("...c,...c->...", normal, ray) / stretch, MIN_NOV)
        length = np.hypot(n_t, n_v)
        sin_g, cos_g, g = n_t / length, n_v / length, np.arctan2(n_t, n_v)
        for side in (1, -1):
            horizon = -side * sin_g  # the cosine to the eye of the surface's own plane
            for k in range(occlusion_steps):
                step = side * scale * FIRST * 2**k
                z = _shifted(depth, sky, step * du, step * dv)
                # z r' - z0 r as differences of what is alike, which keeps its digits on near-by points
                deeper = z - depth
                offset = step * way * z[..., None]
                to = ray * deeper[..., None] + offset
                d2 = np.einsum("...c,...c->...", to, to) + SOFTENING_M**2
                towards_eye = -deeper * stretch - np.einsum("...c,...c->...", offset, ray) / stretch
                weight = np.clip(1 - d2 / occlusion_radius_m**2, 0.0, 1.0) ** 2
                cosine = towards_eye / np.sqrt(d2)
                horizon = np.maximum(horizon, weight * (cosine + side * sin_g) - side * sin_g)
            seen += length * _arc(horizon, side, sin_g, cos_g, g)
        open_ += length * (cos_g + g * sin_g)
    share = seen / open_
    return np.where(sky, 1.0, np.clip(share, 0.0, 1.0))


def _shifted(depth: Array, sky: NDArray[np.bool_], du: int, dv: int) -> Array:
    """Depth of the pixel (du, dv) away; 1e6 where that is sky or beyond the picture."""
    out = np.full(depth.shape, 1e6)
    height, width = depth.shape
    solid = np.where(sky, 1e6, depth)
    to = np.s_[max(0, -dv) : min(height, height - dv), max(0, -du) : min(width, width - du)]
    if to[0].start < to[0].stop and to[1].start < to[1].stop:
        out[to] = solid[to[0].start + dv : to[0].stop + dv, to[1].start + du : to[1].stop + du]
    return out


def _arc(horizon: Array, side: int, sin_g: Array, cos_g: Array, g: Array) -> Array:
    """Cosine-weighted arc from the eye's direction to a horizon, given the cosine to it. Jimenez et al. 2016, eq. 7.

    With h the signed angle to the horizon and g that of the normal: (cos g - cos(2 h - g) + 2 h sin g) / 4.
    """
    cos_h = np.clip(horizon, -1.0, 1.0)
    sin_h = side * np.sqrt(1 - cos_h**2)
    h = np.arctan2(sin_h, cos_h)
    cos_2h, sin_2h = cos_h**2 - sin_h**2, 2 * sin_h * cos_h
    return (cos_g - (cos_2h * cos_g + sin_2h * sin_g) + 2 * h * sin_g) / 4
