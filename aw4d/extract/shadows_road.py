"""Light on the road: asphalt has one reflectance, so what varies on it is light, but for its grain and its markings.

Markings are told from sunlight between shadows by colour: sunlight that falls into a shadow makes it both brighter and
warmer, paint only brighter. In the sun, paint is what is brighter than the asphalt around it.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from aw4d.colour import LUMINANCE
from aw4d.extract.shadows import FLOOR, Sunlight, from_tones, masked_blur, tones

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

PAINT = 0.45  # log ratio of paint to asphalt, at least
COLD = 0.4  # paint in a shadow is colder than light of its brightness would be by this share of the step
SPECK = 8  # [px] smaller ones are no markings
BROAD = 0.08  # of the road's width: a line is narrower
PATCH = 0.3  # log ratio that patches of other asphalt may have where no shadow is near
PATCH_NO_SUN = 0.9  # the same where no sun shines
BORDER = (0.4, 0.7)  # log contrast within 7 px from which on it is a shadow's border
DIM = 0.35  # log ratio under lit asphalt that counts as a shadow
GRAIN = 0.2  # largest log ratio of detail that is kept where a shadow is near


def _brightness(rgb: Image) -> Image:
    return np.asarray(np.log(np.maximum(rgb @ LUMINANCE, FLOOR)), dtype=np.float32)


def _fill(image: Image, known: Mask) -> Image:
    """Fill what is not known from around it, smoothly: pull and push (Gortler et al. 1996), (H, W, C)."""
    weight = known.astype(np.float32)
    levels = [(image * weight[..., None], weight)]
    while min(levels[-1][1].shape) > 1:
        value, weight = levels[-1]
        size = ((weight.shape[1] + 1) // 2, (weight.shape[0] + 1) // 2)
        coarse = np.asarray(cv2.resize(weight, size, interpolation=cv2.INTER_AREA), dtype=np.float32)
        value = np.asarray(cv2.resize(value, size, interpolation=cv2.INTER_AREA), dtype=np.float32)
        levels.append((value.reshape(*coarse.shape, -1), coarse))
    value, weight = levels.pop()
    filled = value / np.maximum(weight, 1e-9)[..., None]
    while levels:
        value, weight = levels.pop()
        above = cv2.resize(filled, weight.shape[::-1], interpolation=cv2.INTER_LINEAR).reshape(value.shape)
        filled = value + above * (1 - weight)[..., None]
    return np.asarray(filled, dtype=np.float32)


def _local_mean(image: Image, mask: Mask, prior: float) -> Image:
    """Mean over a neighbourhood (W / 16 by W / 50), drawn to the prior where the mask has little, (H, W)."""
    height, width = mask.shape
    size = (-(-width // 4), -(-height // 4))
    parts = [cv2.resize(part, size, interpolation=cv2.INTER_AREA) for part in (image * mask, mask.astype(np.float32))]
    total, weight = (cv2.GaussianBlur(part, (0, 0), sigmaX=width / 64, sigmaY=width / 200) for part in parts)
    mean = (total + 0.02 * prior) / (weight + 0.02)
    return np.asarray(cv2.resize(mean, (width, height), interpolation=cv2.INTER_LINEAR), dtype=np.float32)


def _without_lines(brightness: Image, road: Mask) -> Image:
    """Brightness with bright things narrower than a thirtieth of the picture cut off (opening), (H, W)."""
    kernel = np.ones((1, 2 * (road.shape[1] // 60) + 1), np.uint8)
    lowest = cv2.erode(np.where(road, cv2.blur(brightness, (3, 3)), np.float32(np.inf)), kernel)
    opened = cv2.dilate(np.where(np.isfinite(lowest), lowest, np.float32(-np.inf)), kernel)
    return np.where(road, opened, brightness).astype(np.float32)


def lit_level(brightness: Image, road: Mask, sun: Sunlight) -> Image:
    """Log brightness that the road's surface, asphalt or concrete, has around here in the sun, (H, W)."""
    surface = _without_lines(brightness, road)
    lit = road
    if sun.certainty > 0:
        lit = road & (surface > sun.lit[0] - min(0.6, (sun.lit[0] - sun.shadowed[0]) / 2))
    return _local_mean(surface, lit, float(sun.lit[0]))


def markings(rgb: Image, road: Mask, sun: Sunlight) -> tuple[Mask, Image]:
    """Paint on the road, and the level of lit asphalt (`lit_level`) against which it was found, both (H, W)."""
    brightness = _brightness(masked_blur(rgb, road, 0.8))
    level = lit_level(brightness, road, sun)
    evidence = [(brightness - level) / PAINT]
    if sun.certainty > 0:
        warmth = tones(masked_blur(rgb, road, 1.2))[..., 1]
        lift = np.clip((brightness - sun.shadowed[0]) / np.maximum(level - sun.shadowed[0], 0.1), 0, 1)
        warm, cold = sun.lit[1], sun.shadowed[1]
        colder = sun.certainty * (cold + lift * (warm - cold) - warmth) / max(warm - cold, 0.1)
        evidence.append(np.where(lift > 0.4, colder / COLD, 0))
    found, sure = np.zeros_like(road), np.zeros_like(road)
    for strength in evidence:
        own = road & (strength > 1)
        own &= ~_broad(own, road)
        found |= own
        sure |= own & (strength > 1.4)
    _, label, stats, _ = cv2.connectedComponentsWithStats(found.astype(np.uint8), connectivity=8)
    many = np.bincount(label[sure], minlength=len(stats)) >= SPECK // 2
    keep = (stats[:, cv2.CC_STAT_AREA] >= SPECK) & many
    keep[0] = False
    paint = cv2.dilate(keep[label].astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    return paint & road, level


def _broad(found: Mask, road: Mask) -> Mask:
    """Circles that fit into the found and are too broad for a line, compared with the road there; and their rims."""
    width = np.maximum.accumulate(np.count_nonzero(road, axis=1))  # cars hide some of the nearer road
    limit = np.maximum(BROAD * width, SPECK)[:, None] / 2
    core = cv2.distanceTransform(found.astype(np.uint8), cv2.DIST_L2, 3) > limit
    if not core.any():
        return core
    count, label = cv2.connectedComponents(found.astype(np.uint8), connectivity=8)
    joined = np.bincount(label[core], minlength=count) > 0
    near = cv2.distanceTransform((~core).astype(np.uint8), cv2.DIST_L2, 3) <= 3 * limit
    return np.asarray(joined[label] & near, dtype=np.bool_)


def _light(brightness: Image, near: Image, level: Image, certainty: float) -> Image:
    """Log light: brightness without the asphalt's grain (bilateral filter, Tomasi and Manduchi 1998), (H, W).

    On a shadow's border it is the brightness itself: a border that is half followed would leave a bright and a dark
    line. Far from shadows, weak patches are left to the asphalt; strong ones too where the sun casts none.
    """
    light = cv2.bilateralFilter(brightness, 9, 0.35, 3.0)
    light = cv2.bilateralFilter(light, 9, 0.35, 3.0)
    kernel = np.ones((7, 7), np.uint8)
    contrast = cv2.dilate(light, kernel) - cv2.erode(light, kernel)
    border = cv2.blur(np.clip((contrast - BORDER[0]) / (BORDER[1] - BORDER[0]), 0, 1), (3, 3))
    light += certainty * border * (brightness - light)
    patch = light - level
    largest = certainty * PATCH + (1 - certainty) * PATCH_NO_SUN
    light -= (1 - near) * patch * np.exp(-((patch / largest) ** 2))
    return np.asarray(light, dtype=np.float32)


def _near_shadow(brightness: Image, level: Image) -> Image:
    """1 in shadows and around them, falling to 0 within a fortieth of the picture's width, (H, W)."""
    reach = 2 * (brightness.shape[1] // 80) + 1
    dim = cv2.blur(brightness, (5, 5)) < level - DIM
    core = cv2.morphologyEx(dim.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    near = cv2.dilate(core, np.ones((reach, reach), np.uint8)).astype(np.float32)
    return np.asarray(cv2.blur(near, (reach, reach)), dtype=np.float32)


def _relative(rgb: Image, road: Mask, sun: Sunlight) -> Image:
    paint, level = markings(rgb, road, sun)
    plain = road & ~paint
    known = np.dstack([_brightness(rgb), tones(masked_blur(rgb, plain, 2.0))[..., 1:]])
    filled = _fill(known, plain)
    near = sun.certainty * _near_shadow(filled[..., 0], level)
    light = np.dstack([_light(filled[..., 0], near, level, sun.certainty), filled[..., 1:]])
    detail = known[..., 0] - light[..., 0]
    tint = np.log(np.maximum(rgb, FLOOR) / from_tones(light)) - detail[..., None]
    near[paint & (detail > PAINT / 2)] = 0  # what is cold and not brighter is no paint
    detail += near * (GRAIN * np.tanh(detail / GRAIN) - detail)
    return np.exp(detail[..., None] + (1 - near)[..., None] * tint)


def road_albedo(rgb: Image, road: Mask, sun: Sunlight) -> Image:
    """Reflectance of the road relative to plain asphalt, (H, W, 3); 1 off the road.

    Parameters
    ----------
    rgb
        Recorded picture, (H, W, 3) scene-linear.
    road
        (H, W) mask, vehicles left out, not empty.
    sun
        From `aw4d.extract.shadows.sunlight`.
    """
    rows = np.flatnonzero(road.any(axis=1))
    part = slice(int(rows[0]), int(rows[-1]) + 1)
    relative = np.ones_like(rgb)
    relative[part] = np.where(road[part, :, None], _relative(rgb[part], road[part], sun), 1)
    return relative
