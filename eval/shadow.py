"""Shadows that stay: how much of the edges of the source's cast shadows is found again in the edit.

Weather without sun has no cast shadows, and an edit that keeps the recorded ones shows it. Along the borders of the
source's shadows the gradients of log luminance of both pictures are correlated: 1 where the edit has the same edges,
about 0 where they are gone. In the logarithm the brightness of the picture does not matter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from eval.errors import MetricError
from eval.luminance import LINEAR, WEIGHTS, check_picture
from eval.score import Score
from eval.values import Undefined, Value
from eval.view import View

Plane = NDArray[np.float32]

BLUR_PX = 1.5  # standard deviation: grain and coding noise are finer than the penumbra of a tree
FLOOR = 1e-3  # linear; 8-bit codes below it, 0 to 3, have more rounding than picture
STEEP = 0.06  # of log luminance a pixel; grain of asphalt has 0.03
STEP = math.log(2)  # of log luminance across a border, at least: a clear sky gives less light than its sun
ACROSS_PX = 11  # within which that step is made
AROUND_PX = 2.0  # standard deviation of the neighbourhood in which an edge's colour is judged
WARMTH = (0.08, 0.6)  # rise of log red / blue over that of log luminance, from shadow (lit by the sky) into the sun
GREEN = 0.25  # most that log green^2 / (red blue) may change over log luminance: another material
BEND = 0.02  # second difference of inverse depth over inverse depth [per px^2]: 0 on planes, large on edges
MARGIN_PX = 3  # kept from the border of the ground
FEWEST = 100  # pixels of borders in a video

NO_BORDERS = Undefined("no shadow boundaries")
LINEAR32 = LINEAR.astype(np.float32)


class Products(NamedTuple):
    """Sums of products of the gradients over the border pixels of a frame."""

    ref_ref: float
    gen_gen: float
    ref_gen: float
    pixels: int


def gradient(plane: Plane) -> Plane:
    """Gradient [per px], (H, W, 2), by x and by y, of a plane (H, W); Sobel's, exact on ramps."""
    return np.stack([cv2.Sobel(plane, cv2.CV_32F, x, 1 - x, ksize=3, scale=1 / 8) for x in (1, 0)], axis=-1)


def _log_channels(picture: NDArray[np.uint8]) -> tuple[Plane, Plane]:
    """Logarithms of luminance, (H, W), and of the channels, (H, W, 3), after the blur."""
    linear = cv2.GaussianBlur(LINEAR32[picture], (0, 0), BLUR_PX)
    return np.log(linear @ np.array(WEIGHTS, np.float32) + FLOOR), np.log(linear + FLOOR)


def log_luminance(picture: NDArray[np.uint8]) -> Plane:
    """Logarithm of the blurred linear luminance, (H, W), of an sRGB picture, (H, W, 3)."""
    return _log_channels(picture)[0]


def borders(ref: NDArray[np.uint8], ground: NDArray[np.bool_], view: View) -> NDArray[np.bool_]:
    """Borders of cast shadows on the ground, (H, W): steep in brightness, of a shadow's colour, of no shape.

    What lies in the shadow is lit by the blue sky alone, so that red over blue rises into the sun (Finlayson et al.
    2006); paint on asphalt is brighter without being warmer. Concrete beside asphalt is both, and is taken for sun.

    Parameters
    ----------
    ref
        (H, W, 3) sRGB uint8.
    ground
        (H, W) where to look, as a road.
    view
        Depth and masks; sky and what moves are left out.

    Raises
    ------
    MetricError
        A plane is of another kind or size.
    """
    check_picture("shadow", ref)
    view.check("shadow", ref)
    if ground.shape != view.shape or ground.dtype != np.bool_:
        raise MetricError(f"ground: expected {view.shape} bool, got {ground.shape} {ground.dtype.name}")
    size = 2 * MARGIN_PX + 1
    inner = cv2.erode((ground & ~view.sky & ~view.moving).astype(np.uint8), np.ones((size, size), np.uint8)) > 0
    brightness, channels = _log_channels(ref)
    red, green, blue = np.moveaxis(channels, -1, 0)
    slope = gradient(brightness)
    steep = np.linalg.norm(slope, axis=-1) > STEEP
    warmth = _against(slope, gradient(red - blue))
    tint = _against(slope, gradient(2 * green - red - blue))
    shadow = _step(brightness) > STEP
    shadow &= (warmth > WARMTH[0]) & (warmth < WARMTH[1]) & (np.abs(tint) < GREEN)
    return np.asarray(inner & steep & shadow & ~_bent(view))


def _step(brightness: Plane) -> Plane:
    """Brightest over darkest around every pixel."""
    kernel = np.ones((ACROSS_PX, ACROSS_PX), np.uint8)
    return np.asarray(cv2.dilate(brightness, kernel) - cv2.erode(brightness, kernel))


def _against(slope: Plane, other: Plane) -> Plane:
    """Rise of another plane over that of the brightness along its slope: least squares over a neighbourhood."""
    product = cv2.GaussianBlur(np.einsum("...c,...c->...", slope, other), (0, 0), AROUND_PX)
    square = cv2.GaussianBlur(np.einsum("...c,...c->...", slope, slope), (0, 0), AROUND_PX)
    return product / np.maximum(square, np.float32(1e-12))


def _bent(view: View) -> NDArray[np.bool_]:
    """Where the surface is not smooth. Inverse depth is linear in the picture on any plane."""
    inverse = np.where(view.sky, 0, 1 / np.where(view.sky, 1, view.depth)).astype(np.float32)
    bend = np.maximum(*(np.abs(cv2.Sobel(inverse, cv2.CV_32F, x, 2 - x, ksize=1)) for x in (2, 0)))
    return np.asarray(cv2.dilate((bend > BEND * inverse).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0)


@dataclass(frozen=True, kw_only=True)
class Shadow:
    """Correlation of the gradients of log luminance of two pictures along the source's shadow borders, within [-1, 1].

    sum r.g / sqrt(sum r.r sum g.g) over the border pixels of all frames, r and g the gradients of source and edit.
    It tells whether the edges are there, not how strong: that is "strength left", sum r.g / sum r.r, the share of the
    source's contrast that is found again. What moves the number: what is taken for a border; texture of the ground
    that goes the same way; noise of the edit, which lowers the correlation and not the strength.
    """

    def frame(self, ref: NDArray[np.uint8], gen: NDArray[np.uint8], where: NDArray[np.bool_]) -> Products:
        """Products of the gradients of a frame.

        Parameters
        ----------
        ref, gen
            (H, W, 3) sRGB uint8.
        where
            (H, W) True on the source's shadow borders: given, or as `borders` finds them.

        Raises
        ------
        MetricError
            A picture or the mask is of another kind or size.
        """
        for name, picture in (("ref", ref), ("gen", gen)):
            check_picture(f"shadow: {name}", picture)
        if ref.shape != gen.shape:
            raise MetricError(f"shadow: expected two pictures of one size, got {ref.shape} and {gen.shape}")
        if where.shape != ref.shape[:2] or where.dtype != np.bool_:
            raise MetricError(f"shadow: expected borders {ref.shape[:2]} bool, got {where.shape} {where.dtype.name}")
        r, g = (gradient(log_luminance(picture))[where].astype(np.float64) for picture in (ref, gen))
        return Products(float(np.sum(r * r)), float(np.sum(g * g)), float(np.sum(r * g)), int(where.sum()))

    def pool(self, records: Sequence[Products]) -> Score:
        """Correlation over all frames, and of every frame."""
        total = Products(
            math.fsum(record.ref_ref for record in records),
            math.fsum(record.gen_gen for record in records),
            math.fsum(record.ref_gen for record in records),
            sum(record.pixels for record in records),
        )
        return Score(
            value=correlation(total),
            frames=tuple(correlation(record) for record in records),
            others={"strength left": strength(total), "border pixels": float(total.pixels)},
        )

    def summands(self, records: Sequence[Products]) -> NDArray[np.float64]:
        """Products and pixels."""
        return np.array(records, dtype=np.float64)

    def of_sums(self, sums: NDArray[np.float64]) -> Value:
        """Correlation over all frames."""
        ref_ref, gen_gen, ref_gen, pixels = (float(value) for value in sums)
        return correlation(Products(ref_ref, gen_gen, ref_gen, int(pixels)))


PRESETS = {"log luminance": Shadow()}


def correlation(sums: Products) -> Value:
    """sum r.g / sqrt(sum r.r sum g.g); 0 where the edit is even.

    Examples
    --------
    >>> correlation(Products(4.0, 1.0, 2.0, 500)), correlation(Products(4.0, 0.0, 0.0, 500))
    (1.0, 0.0)
    >>> correlation(Products(0.0, 0.0, 0.0, 0))
    Undefined(reason='no shadow boundaries')
    """
    if sums.pixels < FEWEST or not sums.ref_ref:
        return NO_BORDERS
    return sums.ref_gen / math.sqrt(sums.ref_ref * sums.gen_gen) if sums.gen_gen else 0.0


def strength(sums: Products) -> Value:
    """sum r.g / sum r.r: 1 where the edges are the source's, 0.5 where half of their contrast is left.

    Examples
    --------
    >>> strength(Products(4.0, 1.0, 2.0, 500))
    0.5
    """
    return NO_BORDERS if sums.pixels < FEWEST or not sums.ref_ref else sums.ref_gen / sums.ref_ref
