"""Who is seen and who is shaded: bundles of rays against parts.

A bundle has two coordinates in which a part is bounded by a rectangle: pixels for the eye, metres on a plane square to
the sun for shadows. Rays are sorted into the cells of a grid in these coordinates, and a part is intersected only with
the rays in the cells of its rectangle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aw4d.camera import Camera
from aw4d.street.parts import Part
from aw4d.street.shapes import Rays
from aw4d.street.sky import SUN

Array = NDArray[Any]

NEAR = 0.05  # [m] nothing of the street comes nearer to the eye
_SUN_CELLS = 60_000  # of the sun's grid, about: under 2^16, so that the sort by cell is a radix sort
_GROUND = 100.0  # [m] what is larger does not set the extent of the sun's grid
_LIFT = 1e-3  # [m] a shadow ray starts this far from its surface, towards the sun
_EDGES = np.array([(a, a | bit) for bit in (1, 2, 4) for a in range(8) if not a & bit])


@dataclass(frozen=True)
class Grid:
    """Rays that are sorted by cell: those of cell c are starts[c] to starts[c + 1], row after row."""

    rows: int
    columns: int
    starts: NDArray[np.int64]

    def within(self, rect: Sequence[int]) -> Array:
        """Numbers of the rays in the cells of a rectangle (first row, end row, first column, end column)."""
        row = np.arange(max(rect[0], 0), min(rect[1], self.rows))
        first, end = max(rect[2], 0), min(rect[3], self.columns)
        if row.size == 0 or end <= first:
            return np.empty(0, np.int64)
        begin, stop = self.starts[row * self.columns + first], self.starts[row * self.columns + end]
        counts = stop - begin
        shift = begin - (np.cumsum(counts) - counts)
        return np.arange(int(counts.sum())) + np.repeat(shift, counts)


def _corners(parts: Sequence[Part]) -> Array:
    """Corners of the bounds of parts, (P, 8, 3)."""
    bounds = np.array([part.shape.bounds for part in parts])
    pick = (np.arange(8)[:, None] >> np.arange(3)) & 1
    return np.stack([bounds[:, pick[:, axis], axis] for axis in range(3)], axis=-1)


def _pixel_rectangles(parts: Sequence[Part], camera: Camera) -> tuple[Array, Array]:
    """Pixel rectangle that holds each part, (P, 4), and its least depth [m], (P,).

    The convex hull of the corners is clipped at the near plane, so a part beside the eye is bounded as well.
    """
    corners = camera.to_camera(_corners(parts))
    a, b = corners[:, _EDGES[:, 0]], corners[:, _EDGES[:, 1]]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (NEAR - a[..., 2]) / (b[..., 2] - a[..., 2])
    cut = a + np.nan_to_num(share, posinf=0, neginf=0)[..., None] * (b - a)
    crossing = (a[..., 2] < NEAR) != (b[..., 2] < NEAR)
    points = np.concatenate([corners, cut], axis=1)
    valid = np.concatenate([corners[..., 2] >= NEAR, crossing], axis=1)
    z = np.where(valid, np.maximum(points[..., 2], NEAR / 2), 1.0)
    rectangles = []
    for axis in (1, 0):
        at = camera.K[axis, axis] * points[..., axis] / z + camera.K[axis, 2]
        low = np.where(valid, at, np.inf).min(axis=1, initial=np.inf)
        high = np.where(valid, at, -np.inf).max(axis=1, initial=-np.inf)
        limit = camera.shape[1 - axis]
        rectangles += [np.floor(np.clip(low - 0.5, -2, limit)), np.ceil(np.clip(high + 0.5, -2, limit)) + 1]
    return np.stack(rectangles, axis=-1).astype(np.int64), np.maximum(corners[..., 2].min(axis=1), 0)


@dataclass(frozen=True)
class Seen:
    """What each ray of the eye meets: depth [m] (infinite: nothing), number of the part (-1: none), face."""

    depth: NDArray[np.float64]
    part: NDArray[np.int32]
    face: NDArray[np.int16]


def look(parts: Sequence[Part], camera: Camera, rays: Rays, grid: Grid) -> Seen:
    """Nearest part on every ray of the eye, whose t is the depth; near parts first, so that they hide the far ones."""
    count = np.size(rays.direction[0])
    seen = Seen(np.full(count, np.inf), np.full(count, -1, np.int32), np.zeros(count, np.int16))
    rectangles, nearest = _pixel_rectangles(parts, camera)
    for number in np.argsort(nearest, kind="stable"):
        index = grid.within(rectangles[number])
        index = index[seen.depth[index] > nearest[number]]
        if index.size == 0:
            continue
        t, face = parts[number].shape.hit(rays.take(index))
        closer = np.flatnonzero(t < seen.depth[index])
        index = index[closer]
        seen.depth[index], seen.face[index], seen.part[index] = t[closer], face[closer], number
    return seen


def _sun_axes() -> Array:
    """Rows: two axes square to the sun, and the sun's direction."""
    a = np.cross(SUN, (0.0, 1.0, 0.0))
    a /= np.linalg.norm(a)
    return np.stack([a, np.cross(a, SUN), SUN])


def sun_blocked(parts: Sequence[Part], points: Array, wanted: Array) -> NDArray[np.bool_]:
    """Whether a part stands between each surface point and the sun.

    Parameters
    ----------
    parts
        All that casts shadows.
    points
        World positions [m], (3, N).
    wanted
        Points to be tested, (N,); the others come out False.
    """
    axes = _sun_axes()
    corners = turn(axes, np.moveaxis(_corners(parts), -1, 0))
    low, high = corners.min(axis=2), corners.max(axis=2)
    chosen = np.flatnonzero(wanted)
    flat = turn(axes, points[:, chosen])
    # Endless ground would make an endless grid; what lies beyond the other casters goes to the border cells.
    compact = (high - low).max(axis=0) < _GROUND
    origin = low[:2, compact].min(axis=1)
    extent = high[:2, compact].max(axis=1) - origin
    side = float(np.sqrt(extent[0] * extent[1] / _SUN_CELLS))
    rows, columns = (int(n) + 1 for n in extent / side)

    def cells(at: Array) -> NDArray[np.int64]:
        number = np.floor((at[:2] - origin[:, None]) / side)
        return np.clip(number, 0, np.array([[rows - 1], [columns - 1]])).astype(np.int64)

    row, column = cells(flat)
    order, grid = _sort(row * columns + column, rows, columns)
    height = flat[2, order]  # towards the sun [m]; infinite once the point is settled
    start = points[:, chosen[order]] + _LIFT * SUN[:, None]
    rays = Rays((start[0], start[1], start[2]), (float(SUN[0]), float(SUN[1]), float(SUN[2])))
    for part, first, last, top in zip(parts, cells(low).T, cells(high).T, high[2], strict=True):
        index = grid.within((first[0], last[0] + 1, first[1], last[1] + 1))
        index = index[height[index] < top]
        if index.size:
            height[index[part.shape.blocks(rays.take(index))]] = np.inf
    blocked = np.zeros(points.shape[1], np.bool_)
    blocked[chosen[order]] = np.isinf(height)
    return blocked


def turn(matrix: Array, v: Array) -> Array:
    """Matrix times vectors, (3, ...), in plain sums: the same bits on every machine, however many threads it has."""
    return np.stack([m[0] * v[0] + m[1] * v[1] + m[2] * v[2] for m in matrix])


def _sort(cell: Array, rows: int, columns: int) -> tuple[Array, Grid]:
    """Order of rays by cell, and their grid; cells below 2^16 are sorted by radix."""
    order = np.argsort(cell.astype(np.uint16), kind="stable")
    starts = np.zeros(rows * columns + 1, np.int64)
    np.cumsum(np.bincount(cell, minlength=rows * columns), out=starts[1:])
    return order, Grid(rows, columns, starts)
