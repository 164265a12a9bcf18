"""Planes and points against the picture: sizes checked, points turned into pixels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from aw4d.camera import Camera
from aw4d.errors import InputError

Index = NDArray[np.int64]


def check_sizes(camera: Camera, **planes: NDArray[np.generic]) -> None:
    """Refuse planes, by name, that have not the size of the camera's picture.

    Raises
    ------
    InputError
        Names the plane, the size expected and the one that came.
    """
    for name, values in planes.items():
        if values.shape[:2] != camera.shape:
            raise InputError(f"{name}: expected a plane of {camera.shape}, got {values.shape}")


def pixels_of(points: NDArray[np.floating], camera: Camera) -> tuple[Index, Index, Index]:
    """Row, column and index of every point, (N, 3) camera frame [m], that falls on a pixel."""
    index = np.flatnonzero(points[:, 2] > 0)
    u, v, _ = camera.project(points[index]).T
    inside = (u > -0.5) & (u < camera.width - 0.5) & (v > -0.5) & (v < camera.height - 0.5)
    row, column = np.rint(v[inside]).astype(np.int64), np.rint(u[inside]).astype(np.int64)
    return row, column, index[inside]
