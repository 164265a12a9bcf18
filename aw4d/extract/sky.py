"""Sky mask of one frame by colour, smoothness and LiDAR returns; no learned weights.

The daylight sky is the smooth, bright, blue-to-white region that reaches the top of the picture. Its colour is spread
from where it is certain to the whole upper picture, and every pixel that matches it there is sky: that carries the
mask into gaps between branches, and keeps out walls and vehicles of another colour. A laser return proves the
opposite. At night, in a tunnel or under a bridge that hides the top border and all blue, the mask is empty.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from aw4d.camera import Camera
from aw4d.errors import InputError
from aw4d.extract.pixels import pixels_of

Mask = NDArray[np.bool_]
Image = NDArray[np.float32]

LOWEST_ELEVATION = -0.05  # tangent of the lowest ray that may be sky; leaves 3 degrees for an unknown pitch
DARKEST_SKY = 0.30  # sRGB value under which a daylight sky does not fall
SMOOTH = 0.025  # largest standard deviation over 5x5 px where sky is certain (sRGB value)
TOLERANCE = 0.06  # largest deviation from the sky colour of the neighbourhood (sRGB value)
SEED_AREA = 3e-4  # smallest certain region, as a fraction of the picture
BEAM_STEP = 0.025  # [rad] largest angle between a laser's neighbouring beams (1.33 degrees with 32 of them)
GAP_REACH = 0.04  # how far from open sky a gap in a crown is still believed, as a fraction of the width


def _mean(image: Image, size: int) -> Image:
    return np.asarray(cv2.blur(image, (size, size), borderType=cv2.BORDER_REPLICATE), dtype=np.float32)


def _components(mask: Mask) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Labels (H, W) of the 4-connected regions, 0 = none, and a row of (left, top, width, height, area) for each."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)
    stats[0] = 0
    return np.asarray(labels, dtype=np.int32), np.asarray(stats, dtype=np.int32)


def _struck(camera: Camera, points: NDArray[np.float32] | None) -> Mask:
    """Pixels at laser returns and between a return and the next one above it in the column."""
    hit = np.zeros(camera.shape, dtype=np.uint8)
    if points is None:
        return hit > 0
    row, column, _ = pixels_of(points, camera)
    hit[row, column] = 1
    wide = cv2.dilate(hit, np.ones((5, 5), np.uint8))
    step = np.ones((round(BEAM_STEP * camera.K[1, 1]) + 1, 1), np.uint8)
    return np.asarray(cv2.morphologyEx(wide, cv2.MORPH_CLOSE, step) > 0, dtype=np.bool_)


def _candidates(image: Image, camera: Camera) -> Mask:
    """Bright pixels between blue and white, not far below the horizon of a level camera."""
    red, green, blue = cv2.split(image)
    value = image.mean(axis=-1)
    # An overcast or burnt-out sky is neutral; only a strong blue may be dark.
    bright = value > np.where(blue > 1.35 * red, DARKEST_SKY, 0.5)
    warmth = np.where(value > 0.85, 0.08, 0.03)  # a burnt-out sky keeps the cast of the white balance
    cool = (blue >= red - warmth) & (blue >= green - warmth)
    rows = np.arange(camera.height)
    above = (camera.K[1, 2] - rows) / camera.K[1, 1] > LOWEST_ELEVATION
    return np.asarray(bright & cool & above[:, None], dtype=np.bool_)


def _certain(image: Image, candidate: Mask) -> Mask:
    """Smooth candidate regions that reach the top border, or that are blue or vast and end above the lowest row.

    Regions less than half as bright as the largest are walls in the blue shade.
    """
    value = image.mean(axis=-1)
    deviation = np.sqrt(np.maximum(_mean(value * value, 5) - _mean(value, 5) ** 2, 0))
    labels, stats = _components(candidate & (deviation < SMOOTH))
    area = np.maximum(stats[:, cv2.CC_STAT_AREA], 1)
    blueness = np.bincount(labels.ravel(), weights=(image[..., 2] - image[..., 0]).ravel(), minlength=len(stats)) / area
    brightness = np.bincount(labels.ravel(), weights=value.ravel(), minlength=len(stats)) / area
    large = stats[:, cv2.CC_STAT_AREA] >= SEED_AREA * candidate.size
    at_top = stats[:, cv2.CC_STAT_TOP] <= 0.02 * candidate.shape[0]
    blue = blueness > 0.15
    lowest = np.flatnonzero(candidate.any(axis=1)).max(initial=0)
    ends = stats[:, cv2.CC_STAT_TOP] + stats[:, cv2.CC_STAT_HEIGHT] < lowest
    vast = (area > 0.01 * candidate.size) & (stats[:, cv2.CC_STAT_TOP] < 0.2 * candidate.shape[0])
    sky = large & (at_top | ((blue | vast) & ends))
    largest = np.argmax(np.where(sky, area, 0))
    return np.asarray((sky & (brightness >= 0.5 * brightness[largest]))[labels], dtype=np.bool_)


def _spread(image: Image, certain: Mask) -> Image:
    """Colour of the certain sky, carried to every pixel: the mean over the smallest window that holds any."""
    spread = np.zeros_like(image)
    open_ = np.ones(certain.shape, dtype=np.bool_)
    weight = certain.astype(np.float32)
    size = 15
    while open_.any():
        held = _mean(weight, size)
        reached = open_ & (held > 0.02)
        if reached.any():
            spread[reached] = (_mean(image * weight[..., None], size)[reached]) / held[reached, None]
            open_ &= ~reached
        if size > 4 * max(certain.shape):
            spread[open_] = image[certain].mean(axis=0)
            break
        size = 2 * size + 1
    return spread


def _keep(matched: Mask, certain: Mask) -> Mask:
    """Regions that join certain sky, or lie near it and not lower than it."""
    labels, stats = _components(matched)
    area = np.maximum(stats[:, cv2.CC_STAT_AREA], 1)
    joined = np.bincount(labels[certain], minlength=len(stats)) > 0
    distance = cv2.distanceTransform((~(joined[labels] & matched)).astype(np.uint8), cv2.DIST_L2, 3)
    nearest = np.full(len(stats), np.inf)
    np.minimum.at(nearest, labels.ravel(), distance.ravel())
    lowest = np.flatnonzero(certain.any(axis=1)).max(initial=0)
    higher = stats[:, cv2.CC_STAT_TOP] + stats[:, cv2.CC_STAT_HEIGHT] <= lowest
    near = (nearest < GAP_REACH * matched.shape[1]) & higher & (area >= 2e-5 * matched.size)
    keep = joined | near
    keep[0] = False
    return np.asarray(keep[labels], dtype=np.bool_)


def sky_mask(rgb: NDArray[np.uint8], *, camera: Camera, points: NDArray[np.float32] | None) -> Mask:
    """Pixels that see nothing but sky.

    Parameters
    ----------
    rgb
        Recorded image, (H, W, 3) sRGB, uint8.
    camera
        The frame's camera.
    points
        Laser returns in the camera frame [m], (N, 3), or None.

    Returns
    -------
    (H, W) bool. Pixels that mix sky and leaves or wires are not sky.

    Raises
    ------
    InputError
        The image is not uint8 or not of the camera's size.
    """
    if rgb.dtype != np.uint8 or rgb.shape != (*camera.shape, 3):
        raise InputError(f"rgb: expected {(*camera.shape, 3)} uint8, got {rgb.shape} {rgb.dtype.name}")
    image = (rgb.astype(np.float32) / np.float32(255)).astype(np.float32)
    candidate = _candidates(image, camera) & ~_struck(camera, points)
    certain = _certain(image, candidate)
    if not certain.any():
        return certain
    matched = candidate & (np.abs(image - _spread(image, certain)).max(axis=-1) < TOLERANCE)
    # Opening (5x5 px on a picture 1242 px wide) drops wires of sky colour and the sparkle inside crowns.
    size = 2 * round(camera.width / 620) + 1
    kernel = np.ones((size, size), np.uint8)
    opened = cv2.morphologyEx((matched | certain).astype(np.uint8), cv2.MORPH_OPEN, kernel) > 0
    return _keep(opened, certain & opened)
