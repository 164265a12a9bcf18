"""Lat-long maps of the directions of the world.

Row 0 looks up (+y), the last row down. The middle column looks north, which is world -z, and columns go clockwise as
seen from above, so that the map is what an eye inside it sees: azimuth = 360 (column + 0.5) / width - 180 degrees.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def towards(altitude_deg: ArrayLike, azimuth_deg: ArrayLike) -> Array:
    """Unit vectors of the world, (..., 3), at an altitude above the horizon and clockwise from north [deg]."""
    altitude, azimuth = np.radians(altitude_deg), np.radians(azimuth_deg)
    level = np.cos(altitude)
    return np.stack([level * np.sin(azimuth), np.sin(altitude) + 0 * azimuth, -level * np.cos(azimuth)], axis=-1)


def directions(height: int, width: int) -> Array:
    """Unit vectors through the centres of a map's texels, (height, width, 3)."""
    altitude = 90 - (np.arange(height) + 0.5) * (180 / height)
    azimuth = (np.arange(width) + 0.5) * (360 / width) - 180
    return towards(altitude[:, None], azimuth[None, :])


def solid_angles(height: int, width: int) -> Array:
    """Solid angle of every texel [sr], (height, 1); the sum over the map is 4 pi."""
    edges = np.cos(np.linspace(0, np.pi, height + 1))
    return ((edges[:-1] - edges[1:]) * (2 * np.pi / width))[:, None]


def level_irradiance(radiance: Array) -> Array:
    """Irradiance of the upper half of a map on a level surface, (H, W, 3) to (3,)."""
    height, width = radiance.shape[:2]
    edges = np.maximum(np.cos(np.linspace(0, np.pi, height + 1)), 0.0)
    weight = (edges[:-1] ** 2 - edges[1:] ** 2) / 2  # int cos sin over the row, exactly
    return np.einsum("h,hwc->c", weight, radiance) * (2 * np.pi / width)


def sample(radiance: Array, direction: Array) -> Array:
    """Bilinear lookup, (H, W, 3) in unit vectors (..., 3) to (..., 3)."""
    height, width = radiance.shape[:2]
    row = np.arccos(np.clip(direction[..., 1], -1, 1)) / np.pi * height - 0.5
    column = (np.arctan2(direction[..., 0], -direction[..., 2]) / (2 * np.pi) + 0.5) * width - 0.5
    r0, c0 = np.floor(row).astype(int), np.floor(column).astype(int)
    fr, fc = (row - r0)[..., None], (column - c0)[..., None]
    r0, r1 = np.clip(r0, 0, height - 1), np.clip(r0 + 1, 0, height - 1)
    c0, c1 = c0 % width, (c0 + 1) % width
    top = radiance[r0, c0] * (1 - fc) + radiance[r0, c1] * fc
    return top * (1 - fr) + (radiance[r1, c0] * (1 - fc) + radiance[r1, c1] * fc) * fr


def shrink(radiance: Array, height: int, width: int) -> Array:
    """Mean over blocks, weighted by solid angle, to (height, width, 3).

    A map whose size is no multiple is brought to one, by sampling it finer.
    """
    H, W = radiance.shape[:2]
    if H % height or W % width:
        H, W = height * -(-H // height), width * -(-W // width)
        radiance = sample(radiance, directions(H, W))
    weight = solid_angles(H, W)[..., None]
    blocks = (radiance * weight).reshape(height, H // height, width, W // width, 3).sum(axis=(1, 3))
    return blocks / (weight.reshape(height, H // height).sum(axis=1) * (W // width))[:, None, None]
