"""Horizon of a camera that looks along a road: the row in which lane lines and kerbs meet."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from aw4d.errors import InputError

Array = NDArray[np.float64]

FEWEST = 8  # line segments on one point under which there is none
TOLERANCE = np.deg2rad(1.0)  # largest angle between a segment and the direction to the point
HYPOTHESES = 2000


@dataclass(frozen=True, kw_only=True)
class Horizon:
    """Row of the horizon [px] and the pictures that it was seen in; the middle row where none shows it."""

    row: float
    votes: int


def _segments(picture: NDArray[np.uint8]) -> Array:
    """Oblique line segments of the lower two thirds, (n, 4): x0, y0, x1, y1."""
    height, width = picture.shape[:2]
    top = height // 3
    grey = cv2.GaussianBlur(cv2.cvtColor(picture[top:], cv2.COLOR_RGB2GRAY), (5, 5), 0)
    found = cv2.HoughLinesP(cv2.Canny(grey, 50, 150), 1, np.pi / 360, 30, minLineLength=width // 25, maxLineGap=4)
    if found is None:
        return np.empty((0, 4))
    lines = np.asarray(found, dtype=np.float64).reshape(-1, 4) + np.array([0, top, 0, top])
    slope = np.abs(np.arctan2(lines[:, 3] - lines[:, 1], lines[:, 2] - lines[:, 0]))
    slope = np.minimum(slope, np.pi - slope)
    # Level lines are backs of cars and bridges, upright ones are poles: neither points along the road.
    return np.asarray(lines[(slope > np.deg2rad(10)) & (slope < np.deg2rad(80))])


def _vanishing_point(lines: Array, width: int, height: int, rng: np.random.Generator) -> Array | None:
    """Point that most length of segments points to (RANSAC, Fischler and Bolles 1981), or None."""
    if len(lines) < FEWEST:
        return None
    middle, along = (lines[:, :2] + lines[:, 2:]) / 2, lines[:, 2:] - lines[:, :2]
    length = np.linalg.norm(along, axis=-1)
    normal = np.stack([-along[:, 1], along[:, 0]], axis=-1) / length[:, None]
    offset = np.einsum("ij,ij->i", normal, middle)
    first, second = rng.integers(len(lines), size=(2, HYPOTHESES))
    # Two edges of one marking meet anywhere: a pair must differ by 10 degrees.
    determinant = normal[first, 0] * normal[second, 1] - normal[first, 1] * normal[second, 0]
    first, second, determinant = (v[np.abs(determinant) > 0.17] for v in (first, second, determinant))
    x = (offset[first] * normal[second, 1] - offset[second] * normal[first, 1]) / determinant
    y = (normal[first, 0] * offset[second] - normal[second, 0] * offset[first]) / determinant
    point = np.stack([x, y], axis=-1)
    point = point[(x > 0.1 * width) & (x < 0.9 * width) & (y > 0.2 * height) & (y < 0.8 * height)]
    if not len(point):
        return None

    def agreeing(points: Array) -> NDArray[np.bool_]:
        away = points[:, None] - middle
        sine = np.abs(np.einsum("pij,ij->pi", away, normal)) / np.maximum(np.linalg.norm(away, axis=-1), 1e-9)
        return np.asarray(sine < np.sin(TOLERANCE))

    best = agreeing(point)[np.argmax(agreeing(point) @ length)]
    if np.count_nonzero(best) < FEWEST:
        return None
    weight = length[best, None]
    return np.asarray(np.linalg.lstsq(normal[best] * weight, offset[best] * weight[:, 0], rcond=None)[0])


def find_horizon(pictures: Iterable[NDArray[np.uint8]]) -> tuple[Horizon, tuple[int, int]]:
    """Median row of the vanishing points of some pictures of a drive along a straight or gently curved road.

    Parameters
    ----------
    pictures
        (H, W, 3) sRGB uint8, all of one size.

    Returns
    -------
    The horizon, and the pictures' (height, width).

    Raises
    ------
    InputError
        There is no picture.
    """
    rng = np.random.default_rng(0)
    rows: list[float] = []
    shape: tuple[int, int] | None = None
    for picture in pictures:
        shape = picture.shape[0], picture.shape[1]
        point = _vanishing_point(_segments(picture), shape[1], shape[0], rng)
        if point is not None:
            rows.append(float(point[1]))
    if shape is None:
        raise InputError("horizon: expected at least one picture, got none")
    row = float(np.median(rows)) if rows else (shape[0] - 1) / 2
    return Horizon(row=row, votes=len(rows)), shape


def level_pose(row: float, K: Array) -> Array:
    """Pose, 4x4, of a camera without roll whose horizon lies in this row; world x right, y up, z backwards."""
    pitch = np.arctan2(row - K[1, 2], K[1, 1])
    up = np.array([0, -np.cos(pitch), np.sin(pitch)])
    ahead = np.array([0, np.sin(pitch), np.cos(pitch)])
    pose = np.eye(4)
    pose[:3, :3] = np.stack([np.array([1.0, 0, 0]), up, -ahead])
    return pose
