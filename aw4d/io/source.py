"""What every reader gives: a recording, read frame by frame when asked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aw4d.clip import ClipInfo
from aw4d.errors import InputError
from aw4d.gbuffer import Plane

MAX_RANGE = 1e4  # [m] a return from farther is a fault of the file
# Recordings have their world x east, y north, z up; here y is up, and z south keeps it right-handed.
Y_UP_FROM_Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])

# A level camera: its y points down, the world's up; the world's z then points backwards.
LEVEL = np.diag([1.0, -1.0, -1.0, 1.0])


def no_points(index: int) -> None:
    """Points of a recording that has none."""


def no_planes(index: int) -> dict[str, Plane]:
    """Planes of a recording that gives none."""
    return {}


@dataclass(frozen=True, kw_only=True)
class Source:
    """A recording.

    Parameters
    ----------
    info
        Everything but the planes; poses with y up.
    rgb
        Picture of a frame, (H, W, 3) sRGB uint8.
    points
        Laser returns of a frame, (n, 4) float32, camera frame [m] and reflectance 0..1; or None.
    planes
        Planes that the recording gives itself, by name, as `aw4d.gbuffer.PLANES` has them.
    fingerprint
        Names the files and the settings; an ingest is resumed only under the same one.
    camera_height_m
        Height of the camera above the road [m] where it stands in for measured depth, else None.
    relative_depth
        The depth plane is known up to scale and bias only.
    """

    info: ClipInfo
    rgb: Callable[[int], NDArray[np.uint8]]
    fingerprint: str
    points: Callable[[int], NDArray[np.float32] | None] = no_points
    planes: Callable[[int], dict[str, Plane]] = no_planes
    camera_height_m: float | None = None
    relative_depth: bool = False


def check_size(image: NDArray[np.uint8], width: int, height: int, name: str) -> NDArray[np.uint8]:
    """The picture, if it has the clip's size.

    Raises
    ------
    InputError
        It has another size.
    """
    if image.shape[:2] != (height, width):
        got = f"{image.shape[1]}x{image.shape[0]}"
        raise InputError(f"{name}: expected {width}x{height} as in the other frames, got {got}")
    return image


def clean_points(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """Returns that are real, (n, 4): finite, not at the sensor's origin, within 10 km; reflectance clipped to 0..1."""
    with np.errstate(over="ignore", invalid="ignore"):
        reach = np.linalg.norm(points[:, :3], axis=-1)
    kept: NDArray[np.float32] = points[np.isfinite(points).all(axis=-1) & (reach > 1e-3) & (reach < MAX_RANGE)]
    kept[:, 3] = np.clip(kept[:, 3], 0, 1)
    return kept


def about_first(poses: NDArray[np.float64]) -> tuple[NDArray[np.float64], tuple[float, float, float]]:
    """Camera-to-world poses, (N, 4, 4), with the first camera's position as origin, and that position [m]."""
    x, y, z = (float(value) for value in poses[0, :3, 3])
    moved = poses.copy()
    moved[:, :3, 3] -= (x, y, z)
    return moved, (x, y, z)
