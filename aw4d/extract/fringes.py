"""Albedo without fringes: pixels that show partly what is behind their surface take the surface's own colour.

The sky through a crown and along every outline, and the bright wall at the edge of a dark car, are mixed into pixels
whose depth is that of the nearer surface. In another light they would shine in the colour of what is no longer bright.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from aw4d.colour import LUMINANCE

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

BLUE = (0.75, 0.95)  # blue over the larger of red and green: of no leaf, of every sky
SKY_BRIGHTNESS = (0.04, 0.15)  # share of the sky's luminance, likewise
LEAFY = 0.2  # share of the surroundings that are leaves, from which on what looks like sky is sky
WINDOW = 30  # parts of the picture's width that make the surroundings
WHITE_GAP, BLUE_GAP = 2e-3, 2e-2  # largest gap in a crown with white and with blue sky, as a share of the picture
NEAR_SKY = 0.02  # how far from open sky a white gap may be, as a share of the width: farther away it may be a sign
LONG = 4  # times as wide as high is no gap but the railing of a bridge
SPECK = 20  # [px] of any shape
BLUE_SKY = 1.18  # blue over green that no white paint has
RIM = 2  # [px] along an outline that are mixed, on a picture RIM_WIDTH wide
RIM_WIDTH = 1242
BRIGHTER = (1.1, 1.6)  # luminance over that of the inside: of the inside itself, of a mixture with sky
STEP, ALIKE = 0.15, 0.07  # relative difference of inverse depth between, and within, surfaces
DIRECTIONS = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))


def _ramp(values: NDArray[np.floating], ends: tuple[float, float]) -> Image:
    """0 below the first end, 1 above the second."""
    return np.asarray(np.clip((values - ends[0]) / (ends[1] - ends[0]), 0, 1), dtype=np.float32)


def _grown(mask: Mask, size: int) -> Mask:
    """The mask and what is within `size` [px] of it."""
    return np.asarray(cv2.dilate(mask.astype(np.uint8), np.ones((2 * size + 1, 2 * size + 1), np.uint8)) > 0)


def _gaps(rgb: Image, sky: Mask, judged: Mask) -> Image:
    """Share of sky in pixels inside crowns, (H, W)."""
    red, green, blue = cv2.split(rgb)
    warm = np.maximum(np.maximum(red, green), np.float32(1e-4))
    luminance = rgb @ LUMINANCE
    share = _ramp(blue / warm, BLUE) * _ramp(luminance / np.median(luminance[sky]), SKY_BRIGHTNESS) * judged
    size = (2 * (rgb.shape[1] // (2 * WINDOW)) + 1,) * 2
    leaf = judged & (blue < BLUE[0] * warm)
    leafy = cv2.blur(leaf.astype(np.float32), size) > LEAFY * cv2.blur((~sky).astype(np.float32), size)
    share = share * leafy
    return np.asarray(share * _is_gap(share > 0.3, rgb, sky), dtype=np.float32)


def _is_gap(like_sky: Mask, rgb: Image, sky: Mask) -> Mask:
    """Regions that look like sky, and all around them, but for those that may be signs or bridges."""
    _, label, stats, _ = cv2.connectedComponentsWithStats(like_sky.astype(np.uint8), connectivity=4)
    area, wide = np.maximum(stats[:, cv2.CC_STAT_AREA], 1), stats[:, cv2.CC_STAT_WIDTH]
    green, blue = (np.bincount(label.ravel(), weights=rgb[..., c].ravel(), minlength=len(stats)) for c in (1, 2))
    away = cv2.distanceTransform((~sky).astype(np.uint8), cv2.DIST_L2, 3)
    distance = np.full(len(stats), np.inf)
    np.minimum.at(distance, label[like_sky].astype(np.intp), away[like_sky])
    white = (area < WHITE_GAP * sky.size) & (distance < NEAR_SKY * sky.shape[1])
    deep = (area < BLUE_GAP * sky.size) & (blue > BLUE_SKY * green)
    gap = (white | deep) & ((wide < LONG * stats[:, cv2.CC_STAT_HEIGHT]) | (area < SPECK) | (distance < 3))
    gap[0] = True
    return np.asarray(gap[label], dtype=np.bool_)


def _inside(albedo: Image, pure: Mask) -> Image:
    """Albedo of the pure pixels, carried to all others: a narrow mean where there are any near, else a wide one."""
    held = np.dstack([albedo, np.ones(pure.shape, np.float32)]) * pure[..., None]
    total = np.zeros_like(held)
    for weight, size in ((1.0, 7), (0.02, 25), (1e-4, 121)):
        total += np.float32(weight) * cv2.blur(held, (size, size))
    return np.asarray(total[..., :3] / np.maximum(total[..., 3:], 1e-9), dtype=np.float32)


def _without_sky(albedo: Image, rgb: Image, sky: Mask, judged: Mask, width: int) -> Image:
    rim = _grown(sky, width) & ~sky
    share = _gaps(rgb, sky, judged)
    pure = ~sky & ~rim & (share < 0.1)
    if not pure.any():
        return albedo
    inside = _inside(albedo, pure)
    brighter = (albedo @ LUMINANCE) / np.maximum(inside @ LUMINANCE, 1e-4)
    share = np.maximum(share, rim * _ramp(brighter, BRIGHTER))
    share = np.asarray(np.where(sky, 0, share), dtype=np.float32)
    return np.asarray(albedo + share[..., None] * (inside - albedo), dtype=np.float32)


def _steps(inverse: Image, sky: Mask, width: int) -> Mask:
    """Pixels within `width` of a step in depth."""
    log = np.log(inverse)
    step = np.zeros(sky.shape, dtype=np.bool_)
    for axis in (0, 1):
        d = np.abs(np.diff(log, axis=axis)) > STEP
        pad = [(0, 0), (0, 0)]
        pad[axis] = (0, 1)
        step |= np.pad(d, pad)
        pad[axis] = (1, 0)
        step |= np.pad(d, pad)
    return _grown(step & ~sky, width - 1) & ~sky


def _own_side(albedo: Image, inverse: Image, sky: Mask, width: int) -> Image:
    """Albedo near a step in depth: where it is that of the other side, that of the own side instead."""
    band = _steps(inverse, sky, width)
    row, column = np.nonzero(band)
    here, q = np.sqrt(albedo[row, column]), inverse[row, column]
    total = np.zeros((2, len(row), 4), dtype=np.float32)
    pure = ~band & ~sky
    for distance in (width + 1, 2 * width + 2):
        for dv, du in DIRECTIONS:
            v = np.clip(row + dv * distance, 0, sky.shape[0] - 1)
            u = np.clip(column + du * distance, 0, sky.shape[1] - 1)
            ratio = np.abs(inverse[v, u] / q - 1)
            there = np.column_stack([np.sqrt(albedo[v, u]), np.ones(len(v), np.float32)])
            total[0] += there * (pure[v, u] & (ratio < ALIKE))[:, None]
            total[1] += there * (pure[v, u] & (ratio > STEP))[:, None]
    mean = total[..., :3] / np.maximum(total[..., 3:], 1)
    own, other = (((here - side) ** 2).sum(axis=-1) for side in mean)
    foreign = _ramp(own / np.maximum(own + other, 1e-6), (0.4, 0.6)) * (total[..., 3] > 0).all(axis=0)
    out = albedo.copy()
    out[row, column] = (here + foreign[:, None] * (mean[0] - here)) ** 2
    return out


def without_fringes(albedo: Image, *, rgb_linear: Image, depth: Image, sky: Mask, guessed: Mask) -> Image:
    """Albedo with the borders of surfaces and the gaps in crowns in the surface's own colour.

    Parameters
    ----------
    albedo, rgb_linear
        (H, W, 3).
    depth
        (H, W) z [m].
    sky
        (H, W) mask.
    guessed
        (H, W), where no laser beam tells leaves from sky.

    Returns
    -------
    (H, W, 3) float32. The sky keeps what it has.
    """
    width = max(1, round(RIM * sky.shape[1] / RIM_WIDTH))
    clean = _own_side(albedo, (1 / depth).astype(np.float32), sky, width)
    if sky.any():
        lowest = int(np.flatnonzero((sky | guessed).any(axis=1)).max()) + 2 * width + 1
        top = np.s_[:lowest]
        clean[top] = _without_sky(clean[top], rgb_linear[top], sky[top], guessed[top] & ~sky[top], width)
    return clean
