"""Lenses of tail lights in the picture: red parts of a vehicle's albedo beside the place that its box gives a lamp."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

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


@dataclass(frozen=True, kw_only=True, eq=False)
class Lens:
    """A lens beside a place: its pixels, as a mask in a window, where it is from there, and how far it counts.

    `offset` is (3,) [m], camera frame, at the place's depth; `weight` 0 to 1, from nothing to wholly.
    """

    window: tuple[NDArray[np.intp], ...]
    mask: NDArray[np.bool_]
    offset: Array
    weight: float


def find_lens(centre: Array, radius_m: float, camera: Camera, shown: Shown, albedo: NDArray[np.generic]) -> Lens | None:
    """The nearest red part of a vehicle's albedo that is large enough for a lamp; None for none, or where it is far.

    A box tells where a vehicle ends, not where its lamps are, which is off by half a metre on some. Of a vehicle that
    is near enough the picture shows them.

    Parameters
    ----------
    centre, radius_m, camera, shown
        See `faces.add_disc`.
    albedo
        (H, W, 3), of the picture as it was recorded.
    """
    radius = radius_m * camera.K[0, 0] / centre[2] if centre[2] > 0 else 0.0
    weight = min(max((radius - FROM_PX) / (FULL_PX - FROM_PX), 0.0), 1.0)
    if not weight > 0:
        return None
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
    aside = centres + np.array([column[0] - u, row[0] - v])
    distance = np.hypot(*aside.T)
    large = sizes[:, cv2.CC_STAT_AREA] >= SMALLEST * math.pi * radius**2
    large[0] = False  # what is not red
    if not (large & (distance <= half)).any():
        return None
    nearest = int(np.argmin(np.where(large, distance, np.inf)))
    offset = np.append(aside[nearest] / (camera.K[0, 0], camera.K[1, 1]), 0.0) * z
    return Lens(window=window, mask=np.asarray(parts == nearest, dtype=np.bool_), offset=offset, weight=weight)


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

    Flux is that of the disc, but no pixel of the lens is brighter than the lamp.

    Parameters
    ----------
    out, centre, radius_m, radiance, camera, shown
        See `faces.add_disc`.
    albedo
        See `find_lens`.
    """
    lens = find_lens(centre, radius_m, camera, shown, albedo)
    if lens is None:
        add_disc(out, centre, radius_m, radiance, camera, shown)
        return
    disc = math.pi * (radius_m * camera.K[0, 0] / centre[2]) ** 2  # [px]
    share = min(disc / np.count_nonzero(lens.mask), 1.0) * lens.weight
    out[lens.window] += (lens.mask[..., None] * (share * np.asarray(radiance))).astype(np.float32)
    add_disc(out, centre, radius_m, [(1 - lens.weight) * part for part in radiance], camera, shown)
