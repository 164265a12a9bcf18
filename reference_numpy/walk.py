"""The walk up a mirrored ray: what of its lobe things of the picture cover, and their light.

A mirrored ray lies in the plane of the line of sight and the normal, which the picture shows as a line; the rays of a
rough surface's lobe, long at a slant, all but do. So one walk up that line, row by row, serves the whole lobe: a thing
that stands q metres above the mirrored ray, t metres along it, covers the lobe up to the angle q / t. The walk's steps
grow as the square of their number, so that what is near, or far off and small in the picture, is not stepped over;
where a step covers some of a narrow lobe, it is walked again in finer steps, which share out among them what it covers;
a wide one sees the mean of what a step shows, but for the faces of lamps, whose highlight `spot_lights` has drawn.
Behind things that stand before the mirroring place itself nobody knows what the rays meet: that part of the lobe is
left to the surroundings.

Answers, not depths, are interpolated between the two pixels beside the line: nothing appears between two things.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from reference_numpy.mirrored import Mirrored
from reference_numpy.ramps import smoothstep
from reference_numpy.row_means import RowMeans

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

FINER = 5  # steps in the place of one, twice over
EDGE = 0.05  # [1] of the picture's size, over which things at its borders fade
FADE = 0.25  # [1] of reach and thickness, over which they end
HIDDEN_M = 4.0  # [m] that things reach behind what is seen, if they stand before the mirroring place
GROUND_M, GROUND_SLOPE = 0.03, 0.01  # [m], [1] how high above the mirroring place the ground itself may lie
NOTHING = 1e6  # [m] depth of the sky


class Picture:
    """What the frame shows: radiance and depth."""

    def __init__(self, rgb: Array, emissive: Array, depth: Array, fy: float) -> None:
        self.rgb, self.depth, self.fy = rgb, depth, fy
        self.height, self.width = depth.shape
        self.means = RowMeans(np.maximum(rgb - emissive, 0.0), depth < NOTHING)


def walk(picture: Picture, ray: Mirrored, steps: int, reach: float, thickness: float) -> tuple[Array, Array]:
    """Share of the lobes that things cover, (N,), and the sum of their radiance times what they cover, (N, 3)."""
    passed, seen = np.zeros(len(ray.u)), np.zeros((len(ray.u), 4))
    every = np.arange(len(ray.u))
    before = np.zeros_like(ray.v)
    for k in range(1, steps + 1):
        rows = -(-k * k * ray.v // steps**2)
        stride = rows - before
        if not stride.any():
            continue
        there = _Things(picture, ray, every, rows, stride, reach, thickness)
        to = np.maximum(passed, there.up_to)
        finer = ramp(2 - 2 * there.wide / np.maximum(stride, 1)) * (stride > 1)
        blurred = (1 - finer) * (to - passed)
        if blurred.any():
            seen += blurred[:, None] * there.mean()
        on = np.flatnonzero(finer * (to - passed) > 0)
        if len(on):
            sums = _walk_finer(picture, ray, on, before[on], stride[on], passed[on], to[on], reach, thickness)
            seen[on] += finer[on, None] * sums
        passed, before = to, rows
    return seen[:, 3], seen[:, :3]


def _walk_finer(
    picture: Picture, ray: Mirrored, on: Ints, start: Ints, stride: Ints, passed: Array, to: Array, reach: float,
    thickness: float,
) -> Array:  # fmt: skip
    """One step in finer ones, twice over: what is found times what it covers from `passed` to `to`, (M, 4)."""
    seen = np.zeros((len(on), 4))
    before = start
    for i in range(1, FINER + 1):
        rows = start - (-i * stride // FINER)
        most = np.clip(_Things(picture, ray, on, rows, stride, reach, thickness).up_to, passed, to)
        last = before
        for j in range(1, FINER + 1):
            row = before - (-j * (rows - before) // FINER)
            if (row == last).all():
                continue
            there = _Things(picture, ray, on, row, stride, reach, thickness)
            now = np.clip(there.up_to, passed, most)
            if (now > passed).any():
                seen += (now - passed)[:, None] * there.own()
            passed, last = now, row
        before = rows
    return seen


class _Things:
    """What the picture shows `rows` above the pixels, between two of its columns.

    Attributes
    ----------
    up_to
        (M,) share of the lobe below it.
    wide
        (M,) half the lobe's width there [px].
    """

    def __init__(
        self, picture: Picture, ray: Mirrored, on: Ints, rows: Ints, stride: Ints, reach: float, thickness: float
    ) -> None:
        self._picture, self._stride = picture, stride
        U = ray.u[on] - rows * ray.lean[on]
        x = np.clip(np.floor(U), 0, picture.width - 1).astype(int)
        y = ray.v[on] - rows
        w = ramp(U - x)
        inside = ramp(np.minimum(U, picture.width - 1 - U) / (EDGE * picture.width))
        inside = inside * ramp(y / (EDGE * picture.height))
        self.up_to, self.wide = np.zeros(len(on)), np.zeros(len(on))
        self._sides = []
        for side, part in ((0, 1 - w), (1, w)):
            at = y, np.minimum(x + side, picture.width - 1)
            z = picture.depth[at]
            covers, lobe = _covers(ray, on, z, x + side, rows, stride, picture.fy, reach, thickness)
            self._sides.append((at, part * inside * covers))
            self.up_to += part * inside * (covers + _hides(ray.Z0[on] - z, ray.near[on]))
            self.wide += part * lobe

    def own(self) -> Array:
        """(M, 4) its radiance, and 1, where it is a thing that is mirrored and not one that hides the rays."""
        return self._shared(lambda at: self._picture.rgb[at])

    def mean(self) -> Array:
        """(M, 4) the same in the step's mean."""
        return self._shared(lambda at: self._picture.means.around(*at, self._stride, self._picture.rgb[at]))

    def _shared(self, light: Callable[[tuple[Ints, Ints]], Array]) -> Array:
        sums = np.zeros((len(self.up_to), 4))
        for at, part in self._sides:
            sums[:, :3] += part[:, None] * light(at)
            sums[:, 3] += part
        return sums / np.maximum(self.up_to, 1e-30)[:, None]


def _covers(
    ray: Mirrored, on: Ints, z: Array, x: Ints, rows: Ints, stride: Ints, fy: float, reach: float, thickness: float
) -> tuple[Array, Array]:
    """Share of the lobe below a thing at depth z in a pixel, if it counts; and half the lobe's width there [px]."""
    d = z - ray.Z0[on]
    q, h = (height(on, z, x - ray.u[on], rows) for height in (ray.above_ray, ray.above_place))
    t = np.maximum(d, 0.0) * ray.inv_Lz[on]
    pixel = z / fy
    width = pixel + ray.lobe[on] * t
    below = ray.below[on]
    share = np.maximum(smoothstep(0.0, 1.0, 0.5 + 0.5 * q / width) - below, 0.0) / (1 - below)
    thick = thickness + stride * pixel
    share = share * ramp(1 + (thick + width - q) / (FADE * thick))
    share = share * ramp(h / (GROUND_M + GROUND_SLOPE * t) - 1)
    share = share * ramp(d / ray.near[on]) * ramp((reach - t) / (FADE * reach))
    return share, width / pixel


def _hides(before: Array, near: Array) -> Array:
    """Whether a thing stands before the mirroring place [m], so that its rays rise behind it, 0 to 1."""
    return ramp(before / near - 1) * ramp((HIDDEN_M - before) / (FADE * HIDDEN_M))


def ramp(x: Array) -> Array:
    return np.clip(x, 0.0, 1.0)
