"""Which LiDAR returns the camera can see: the scanner sits elsewhere and looks past what is in the camera's way."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d
from scipy.spatial import cKDTree

from aw4d.camera import Camera
from aw4d.errors import InputError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

HALF_WIDTH = 10.0  # [px] of the ellipse in which a nearer return hides a farther one
HALF_HEIGHT = 5.0  # [px]
NEARER_BY = 1.0  # [m]
NEARER_RATIO = 1.15
RIM_WIDTH = 8  # [px] to either side in which returns tell how high the scan reaches


def _project(points: NDArray[np.float32], camera: Camera, margin: float) -> tuple[Array, Mask]:
    """Pixel coordinates and depth (N, 3), and which are finite, before the eye and within `margin` of the image."""
    points = np.asarray(points)
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"points: expected (N, 3) in metres, camera frame, got shape {points.shape}")
    uvz = camera.project(points)
    u, v, z = uvz.T
    edge = margin + 0.5  # the outermost pixels reach half a pixel beyond their centres
    inside = np.isfinite(uvz).all(axis=1) & (z > 0) & (u >= -edge) & (u < camera.width - 1 + edge)
    return uvz, inside & (v >= -edge) & (v < camera.height - 1 + edge)


def _seen(uvz: Array) -> Mask:
    """Which of the projected returns (N, 3) no nearer one hides."""
    seen = np.ones(len(uvz), dtype=np.bool_)
    if len(uvz) < 2:
        return seen
    first, second = cKDTree(uvz[:, :2] / (HALF_WIDTH, HALF_HEIGHT)).query_pairs(1.0, output_type="ndarray").T
    swap = uvz[first, 2] > uvz[second, 2]
    near, far = np.where(swap, second, first), np.where(swap, first, second)
    z_near, z_far = uvz[near, 2], uvz[far, 2]
    seen[far[(z_far - z_near > NEARER_BY) & (z_far > NEARER_RATIO * z_near)]] = False
    return seen


def visible_uvz(points: NDArray[np.float32], *, camera: Camera, margin: float = 0.0) -> Array:
    """Pixel coordinates and depth (u [px], v [px], z [m]) of the returns that the camera can see, (M, 3).

    Parameters
    ----------
    points
        (N, 3) in the camera frame [m].
    camera
        The frame's camera.
    margin
        How far outside the image a return may lie [px].

    Raises
    ------
    InputError
        `points` is not (N, 3).
    """
    uvz, inside = _project(points, camera, margin)
    uvz = uvz[inside]
    return np.asarray(uvz[_seen(uvz)])


def visible_returns(points: NDArray[np.float32], *, camera: Camera) -> Mask:
    """Returns that the camera can see.

    A return is hidden when another one inside the ellipse of half axes 10 px (across) and 5 px (down) around it is
    nearer by more than 1 m and by more than 15 %.

    Parameters
    ----------
    points
        (N, 3) in the camera frame [m].
    camera
        The frame's camera.

    Returns
    -------
    NDArray[np.bool_]
        (N,), False also for returns that are not finite, behind the eye or outside the image.

    Raises
    ------
    InputError
        `points` is not (N, 3).
    """
    uvz, visible = _project(points, camera, margin=0.0)
    visible[visible] = _seen(uvz[visible])
    return visible


def above_scan(pixels: Array, camera: Camera, *, margin: int = 0) -> Mask:
    """Pixels more than `margin` rows above all returns, (N, 2) pixel coordinates, around their column, (H, W)."""
    column = np.clip(np.rint(pixels[:, 0]), 0, camera.width - 1).astype(np.intp)
    highest = np.full(camera.width, np.inf)
    np.minimum.at(highest, column, pixels[:, 1])
    highest = minimum_filter1d(highest, 2 * RIM_WIDTH + 1, mode="nearest")
    return np.asarray(np.arange(camera.height)[:, None] < highest - margin, dtype=np.bool_)
