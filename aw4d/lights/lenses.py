"""Lenses of tail lights in the picture: red parts of a vehicle's albedo beside the place that its box gives a lamp."""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from aw4d.camera import Camera
from aw4d.lights.faces import Shown, add_disc

RED = 2.0  # times the larger of green and blue
BRIGHTEST_BLACK = 0.08  # albedo of red below which nothing is a lens
AROUND_M = 0.5  # how far a lens is from where the box has it
SMALLEST = 0.5  # of the area of the disc: reflectors, lower down, are smaller
FROM_PX, FULL_PX = 3.0, 6.0  # [px] radius of the disc from which a lens begins to take its place, and does so wholly

Array = NDArray[np.float64]


def add_tail_face(
    out: NDArray[np.float32],
    centre: Array,
    radius_m: float,
    radiance: Sequence[float],
    camera: Camera,
    shown: Shown,
    albedo: NDArray[np.generic],
) -> None:
    """Add the face of a tail light to (H, W, 3) radiance, in place: its lens where one is seen near by, else a disc.

    A box tells where a vehicle ends, not where its lamps are, which is off by half a metre on some. Of a vehicle that
    is near enough the picture shows them: red parts of its albedo. Flux is that of the disc, but no pixel of the lens
    is brighter than the lamp.

    Parameters
    ----------
    out, centre, radius_m, radiance, camera, shown
        See `faces.add_disc`.
    albedo
        (H, W, 3), of the picture as it was recorded.
    """
    radius = radius_m * camera.K[0, 0] / centre[2] if centre[2] > 0 else 0.0
    by_lens = min(max((radius - FROM_PX) / (FULL_PX - FROM_PX), 0.0), 1.0)
    found = _lens(centre, radius, camera, shown, albedo) if by_lens > 0 else None
    if found is None:
        add_disc(out, centre, radius_m, radiance, camera, shown)
        return
    window, lens = found
    share = min(math.pi * radius**2 / np.count_nonzero(lens), 1.0) * by_lens
    out[window] += (lens[..., None] * (share * np.asarray(radiance))).astype(np.float32)
    add_disc(out, centre, radius_m, [(1 - by_lens) * part for part in radiance], camera, shown)


def _lens(
    centre: Array, radius: float, camera: Camera, shown: Shown, albedo: NDArray[np.generic]
) -> tuple[tuple[NDArray[np.intp], ...], NDArray[np.bool_]] | None:
    """The nearest red part that is large enough for a lamp whose disc has that radius [px]: a window and its mask."""
    u, v, z = (float(c) for c in camera.project(centre))
    half = AROUND_M * camera.K[0, 0] / z
    column = np.arange(max(math.floor(u - half), 0), min(math.ceil(u + half) + 1, camera.width))
    row = np.arange(max(math.floor(v - half), 0), min(math.ceil(v + half) + 1, camera.height))
    if not (column.size and row.size):
        return None
    window = np.ix_(row, column)
    red, green, blue = (albedo[..., c][window].astype(np.float32) for c in range(3))
    mask = shown(window, z) & (red > RED * np.maximum(green, blue)) & (red > BRIGHTEST_BLACK)
    _, parts, sizes, centres = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    distance = np.hypot(centres[:, 0] + column[0] - u, centres[:, 1] + row[0] - v)
    large = sizes[:, cv2.CC_STAT_AREA] >= SMALLEST * math.pi * radius**2
    large[0] = False  # what is not red
    if not (large & (distance <= half)).any():
        return None
    nearest = int(np.argmin(np.where(large, distance, np.inf)))
    return window, np.asarray(parts == nearest, dtype=np.bool_)
