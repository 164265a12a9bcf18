"""Visibility in fog: how fast the contrast of dark surfaces against the horizon falls with their distance.

Koschmieder 1924: through a homogeneous veil a surface of radiance J at range s shows

    I(s) = J T + A (1 - T) = A - (A - J) T,    T = exp(-sigma_t s),

A the airlight, as the horizon shows it. Its contrast against the horizon, (A - I) / A, falls as T, plainest to see on
what is dark, J << A. In nearly all places something is nearly black: shade, tyres, leaves (the dark channel of He, Sun
and Tang 2009). So: the darkest of the surfaces at every range, and a fit of A, A - J and sigma_t. It needs no knowledge
of the light that the edit puts in, nor of albedo, and it lives on brightness over large areas, which H.264 and 8 bits
leave as it is; gradients of far surfaces do not survive them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.stats import t as student

from eval.luminance import check_picture, luminance
from eval.score import Score
from eval.values import Undefined, Value
from eval.view import View

Array = NDArray[np.float64]

CONTRAST = 0.02  # left at the visibility, Koschmieder 1924
KOSCHMIEDER = -math.log(CONTRAST)
TILE = 2  # [px] side of the squares that are averaged: against noise; large ones mix dark with bright where it is far
FLAT = 1.1  # farthest over nearest pixel of a tile on one surface
STEP = 1.1  # far over near end of a class of ranges
FARTHEST_M = 1000.0
SKY_M = 1e7  # the sky's range: any extinction there is has hidden all
THINNEST, THICKEST = 1e-5, 1.0  # [1/m] sigma_t that a fit starts from
DARK = 100  # one of so many tiles makes the level of a class; classes of fewer have none
FEWEST = 6  # classes that a fit of three unknowns takes
CERTAIN = 5.0  # standard errors from 0 at which there is extinction; residuals of neighbouring ranges are alike
ALL_LOSS = 0.9  # of contrast over the depth's reach, at which the farthest surfaces show the horizon themselves
LEAST_LOSS = 0.2  # of contrast over the depth's reach; in clear air the dark itself loses up to 0.07
BLACKEST = 1.2  # contrast at range 0: black has 1, the rest is the fit's error; more is a fit of a single point
RESOLUTION = 1e-4  # of linear luminance: residuals below it are rounding
HUBER = 1.345  # standard deviations; 95 % efficient on normal residuals, Huber 1964
TO_STANDARD_DEVIATION = 1.4826  # of a median absolute deviation


class DarkLevels(NamedTuple):
    """The dark of one frame by classes of range; all (n,), classes without a level have 0 tiles."""

    tiles: Array
    range_m: Array
    level: Array
    sky: float | None  # median luminance


class Veil(NamedTuple):
    """A fit of I(s) = A (1 - C0 exp(-sigma_t s))."""

    sigma_t: float
    error: float  # standard error of sigma_t
    horizon: float
    contrast: float  # C0, at range 0
    r2: float
    reach_m: float  # from the nearest surface to the farthest
    points: int


def sigma_to_visibility(sigma_t: float) -> float:
    """Range [m] at which 2 % of contrast is left: V = -ln(0.02) / sigma_t.

    Examples
    --------
    >>> round(sigma_to_visibility(0.03912), 3)
    100.001
    """
    return KOSCHMIEDER / sigma_t


@dataclass(frozen=True, kw_only=True)
class Visibility:
    """Visibility [m] of a video whose frames' depth is known.

    Every class of range, 10 % wide, gives the mean of its darkest hundredth. Least squares with Huber's loss over these
    points, each of the same weight, find A, C0 and sigma_t. Where the surfaces lose less than nine tenths of their
    contrast they do not show A by themselves: then the sky's median is one more point, infinitely far. Undefined where
    sigma_t is not five standard errors from 0, or takes less than a fifth of the contrast over the depth's reach:
    what is darkest in the scene gets a little brighter with range by itself, since far pixels mix more surfaces.

    What moves the number: glow of lamps in the fog, a veil that is brighter near them (the built-in street at 50 m with
    all lamps on reads 59 m, with them off 50); an exposure that changes in the video; grading that is not linear;
    in thin fog a sky that is not the veil's. Fog under 30 m reads too thin, since little is seen beyond `near_m`.

    Parameters
    ----------
    near_m
        Nearest range that is used [m]: nearer ones show little more than a road in the car's own headlights.
    """

    near_m: float = 10.0

    def frame(self, picture: NDArray[np.uint8], view: View) -> DarkLevels:
        """Dark levels of a frame.

        Parameters
        ----------
        picture
            (H, W, 3) sRGB uint8.
        view
            Its depth, camera and sky.

        Raises
        ------
        MetricError
            The picture is of another kind, or of another size than the depth.
        """
        check_picture("visibility", picture)
        view.check("visibility", picture)
        ranges, bright, sky = _tiles(view.ranges()), _tiles(luminance(picture)), _tiles(view.sky)
        nearest, farthest = ranges.min(axis=-1), ranges.max(axis=-1)
        surface = ~sky.any(axis=-1) & (farthest < FLAT * nearest) & (nearest >= self.near_m) & (farthest < FARTHEST_M)
        level = bright.mean(axis=-1, dtype=np.float64)
        clear = level[sky.all(axis=-1)]
        found = dark_levels(ranges.mean(axis=-1)[surface], level[surface], near_m=self.near_m)
        return found._replace(sky=float(np.median(clear)) if clear.size >= DARK else None)

    def pool(self, records: Sequence[DarkLevels]) -> Score:
        """Visibility of all frames' levels, and of every frame's alone."""
        veil = _veil(records)
        frames = tuple(_visibility(_veil([record])) for record in records)
        return Score(value=_visibility(veil), frames=frames, others=_others(veil), interval=_interval(veil))


PRESETS = {"koschmieder": Visibility()}


def _tiles(plane: NDArray[Any]) -> NDArray[Any]:
    """Squares of TILE pixels, (rows * columns, TILE^2); the rest at the right and the bottom is left out."""
    rows, columns = plane.shape[0] // TILE, plane.shape[1] // TILE
    cut = plane[: rows * TILE, : columns * TILE].reshape(rows, TILE, columns, TILE)
    return cut.swapaxes(1, 2).reshape(rows * columns, TILE * TILE)


def dark_levels(range_m: Array, level: Array, *, near_m: float) -> DarkLevels:
    """Mean level and range of the darkest hundredth of the tiles, (n,), by classes of their range [m], >= near_m.

    The range is that of these tiles themselves: in a veil the darkest of a class are its nearest.

    Examples
    --------
    >>> found = dark_levels(np.linspace(10, 10.9, 200), np.arange(200.0), near_m=10.0)
    >>> float(found.tiles[0]), float(found.level[0])
    (200.0, 0.5)
    """
    classes = math.ceil(math.log(FARTHEST_M / near_m) / math.log(STEP))
    index = (np.log(range_m / near_m) / math.log(STEP)).astype(np.intp)
    tiles = np.bincount(index, minlength=classes)
    picked = tiles // DARK
    order = np.lexsort((level, index))
    rank = np.arange(len(order)) - (np.cumsum(tiles) - tiles)[index[order]]
    dark = order[rank < picked[index[order]]]
    sums = (np.bincount(index[dark], values[dark], classes) for values in (range_m, level))
    mean_range, mean_level = (total / np.maximum(picked, 1) for total in sums)
    return DarkLevels(np.where(picked > 0, tiles, 0).astype(np.float64), mean_range, mean_level, None)


def _veil(records: Sequence[DarkLevels]) -> Veil | Undefined:
    """The veil that the surfaces show, with the sky where it takes one to know the horizon."""
    if not records:
        return Undefined("no frames")
    weight = np.array([record.tiles for record in records])
    total = weight.sum(axis=0)
    seen = total > 0
    share = weight[:, seen] / total[seen]
    range_m = (share * np.array([record.range_m for record in records])[:, seen]).sum(axis=0)
    level = (share * np.array([record.level for record in records])[:, seen]).sum(axis=0)
    veil = fit(range_m, level)
    sky = [record.sky for record in records if record.sky is not None]
    if not sky or isinstance(veil, Undefined) or _is_extinct(veil, ALL_LOSS):
        return veil
    return fit(np.append(range_m, SKY_M), np.append(level, np.mean(sky)))


def _is_extinct(veil: Veil, loss: float) -> bool:
    """Whether contrast certainly falls, and by that much from the nearest surface to the farthest."""
    certain = 0 < veil.contrast < BLACKEST and veil.sigma_t > CERTAIN * veil.error
    return certain and veil.sigma_t * veil.reach_m > -math.log1p(-loss)


def fit(range_m: Array, level: Array) -> Veil | Undefined:
    """Fit I(s) = A - B exp(-sigma_t s) to points, (n,), with Huber's loss; C0 = B / A.

    Parameters
    ----------
    range_m
        Ranges s [m]; `SKY_M` for the sky.
    level
        Linear luminance I.

    Examples
    --------
    >>> s = np.linspace(10, 100, 30)
    >>> veil = fit(s, 0.5 * (1 - 0.9 * np.exp(-0.04 * s)))
    >>> round(veil.sigma_t, 6), round(veil.horizon, 6), round(veil.contrast, 6)
    (0.04, 0.5, 0.9)
    """
    if len(range_m) < FEWEST:
        return Undefined(f"surfaces at fewer than {FEWEST} ranges")
    if np.ptp(level) < RESOLUTION:
        return Undefined("surfaces of all ranges are alike")

    def residuals(p: Array) -> Array:
        return np.asarray(p[0] - p[1] * np.exp(-p[2] * range_m) - level)

    def jacobian(p: Array) -> Array:
        fade = np.exp(-p[2] * range_m)
        return np.stack([np.ones_like(fade), -fade, p[1] * range_m * fade], axis=1)

    start = _start(range_m, level)
    scale = max(TO_STANDARD_DEVIATION * float(np.median(np.abs(residuals(start)))), RESOLUTION)
    bounds = ([-np.inf, -np.inf, THINNEST / 2], [np.inf, np.inf, 2 * THICKEST])
    found = least_squares(residuals, start, jacobian, bounds, loss="huber", f_scale=HUBER * scale, x_scale="jac")
    # Gauss and Newton's covariance; SciPy's Jacobian has the loss' weights in it already.
    covariance = np.linalg.pinv(found.jac.T @ found.jac) * 2 * found.cost / (len(level) - 3)
    surface = range_m < SKY_M
    unexplained = np.sum(residuals(found.x)[surface] ** 2)
    A, B, sigma_t = (float(value) for value in found.x)
    r2 = 1 - unexplained / np.sum((level[surface] - level[surface].mean()) ** 2)
    reach_m = float(np.ptp(range_m[surface]))
    return Veil(sigma_t, math.sqrt(covariance[2, 2]), A, B / A, float(r2), reach_m, len(level))


def _start(range_m: Array, level: Array) -> Array:
    """Least squares over a grid of sigma_t; the rest is linear."""
    grid = np.geomspace(THINNEST, THICKEST, 200)
    fade = np.exp(-grid[:, None] * range_m)
    fade_off = fade - fade.mean(axis=1, keepdims=True)
    level_off = level - level.mean()
    slope = (fade_off @ level_off) / np.sum(fade_off**2, axis=1)
    best = int(np.argmin(np.sum((level_off - slope[:, None] * fade_off) ** 2, axis=1)))
    return np.array([level.mean() - slope[best] * fade[best].mean(), -slope[best], grid[best]])


def _visibility(veil: Veil | Undefined) -> Value:
    if isinstance(veil, Undefined):
        return veil
    if not _is_extinct(veil, LEAST_LOSS):
        return Undefined("extinction within the depth's reach is not told from none")
    return sigma_to_visibility(veil.sigma_t)


def _interval(veil: Veil | Undefined) -> tuple[float, float] | None:
    """Ends of the visibility's 95 % interval, where there is a visibility and both ends exist."""
    if isinstance(veil, Undefined) or isinstance(_visibility(veil), Undefined):
        return None
    half = _half_width(veil)
    if half >= veil.sigma_t:
        return None
    return sigma_to_visibility(veil.sigma_t + half), sigma_to_visibility(veil.sigma_t - half)


def _half_width(veil: Veil) -> float:
    """Half of sigma_t's 95 % interval."""
    return float(student.ppf(0.975, veil.points - 3)) * veil.error


def _others(veil: Veil | Undefined) -> dict[str, Value]:
    """The fit's other figures; the interval is that of 95 %."""
    if isinstance(veil, Undefined):
        return {}
    half = _half_width(veil)
    return {
        "sigma_t": veil.sigma_t,
        "sigma_t low": max(veil.sigma_t - half, 0.0),
        "sigma_t high": veil.sigma_t + half,
        "least visibility": sigma_to_visibility(veil.sigma_t + half),
        "horizon": veil.horizon,
        "contrast at 0 m": veil.contrast,
        "R2": veil.r2,
        "points": float(veil.points),
    }
