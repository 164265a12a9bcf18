"""Albedo, roughness and metallic of one frame by kind of surface and picture statistics.

Approximations, in the order in which they are made:

- the road is grey asphalt of one reflectance with markings on it: what else varies on it is light (`shadows_road`);
- elsewhere, but on vehicles, cast shadows are found by the step in brightness and colour that the road shows
  (`shadows`), and lifted by it;
- lit asphalt tells the colour of the light; the geometric mean of all that is not sky, shadows lifted, is taken for
  an average grey, which tells its strength;
- light comes from a uniform sky and from the ground below it, so a wall is lit less than a road;
- half of what varies slowly over the picture off the road, in log brightness, is light;
- roughness depends on the kind of surface alone, and nothing is a bare metal: car paint has a clear dielectric coat.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from aw4d.colour import LUMINANCE
from aw4d.errors import InputError
from aw4d.extract.shadows import Sunlight, from_tones, masked_blur, shadow_matte, sunlight
from aw4d.extract.shadows_road import road_albedo

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

ASPHALT = 0.12  # reflectance of worn asphalt (Akbari et al. 2001 give 0.05 to 0.15 over its age)
GREY = 0.15  # geometric mean reflectance of a street scene: foliage, grass, walls, asphalt
GROUND_BOUNCE = 0.2  # share of the sky's light that comes back from the ground
DARKEST, BRIGHTEST = 0.02, 0.9  # reflectances between which outdoor surfaces lie
HOLE = 5e-3  # share of the picture under which a hole in the road may be paint
SHADING_OTHER = 0.5  # share of slow variation in log brightness that is taken for light
EDGE_VARIANCE = 0.5  # variance of log brightness within a window above which an edge is kept
ROUGHNESS_ROAD, ROUGHNESS_VEHICLE, ROUGHNESS_OTHER = 0.9, 0.35, 0.8


def _colour_of_light(rgb: Image, road: Mask, ground: Mask, sun: Sunlight | None) -> Image:
    """Colour of the light, (3,) with luminance 1: that of lit asphalt, or of the ground where there is little of it."""
    if sun is not None and sun.certainty > 0:
        colour = from_tones(sun.lit)
    else:
        region = road if np.count_nonzero(road) >= 0.005 * road.size else ground
        colour = rgb[region].mean(axis=0) if region.any() else np.ones(3, dtype=np.float32)
    colour = np.maximum(colour, np.float32(1e-4))
    return np.asarray(colour / (colour @ LUMINANCE), dtype=np.float32)


def _sky_exposure(normal: Image) -> Image:
    """Light from a uniform sky and the ground under it on a surface, relative to a level one, (H, W).

    The sky fills (1 + cos) / 2 of what a surface inclined against a level camera's up sees.
    """
    cosine = -cv2.blur(normal, (15, 15))[..., 1]
    sky_share = (1 + np.clip(cosine, -1, 1)) / 2
    return np.asarray(sky_share + GROUND_BOUNCE * (1 - sky_share), dtype=np.float32)


def _slow(log_luminance: Image, valid: Mask) -> Image:
    """What varies slowly over the valid part: guided filter with itself as guide (He, Sun and Tang 2013)."""
    size = (2 * (log_luminance.shape[1] // 40) + 1,) * 2
    weight = np.maximum(cv2.blur(valid.astype(np.float32), size), 1e-6)
    held = np.where(valid, log_luminance, 0)
    mean = cv2.blur(held, size) / weight
    variance = np.maximum(cv2.blur(held * held, size) / weight - mean**2, 0)
    slope = variance / (variance + EDGE_VARIANCE)
    offset = mean * (1 - slope)
    slope = cv2.blur(np.where(valid, slope, 0), size) / weight
    offset = cv2.blur(np.where(valid, offset, 0), size) / weight
    return np.asarray(slope * log_luminance + offset, dtype=np.float32)


def _with_paint(rgb: Image, road: Mask) -> Mask:
    """The road with the small bright holes in it, which are paint that the mask left out."""
    if not road.any():
        return road
    _, label, stats, _ = cv2.connectedComponentsWithStats((~road).astype(np.uint8), connectivity=4)
    small = stats[:, cv2.CC_STAT_AREA] < HOLE * road.size
    small[0] = False  # the road itself
    brightness = rgb @ LUMINANCE
    return np.asarray(road | (small[label] & (brightness > 1.5 * np.median(brightness[road]))), dtype=np.bool_)


def _lifted(rgb: Image, where: Mask, body: Mask, sun: Sunlight) -> Image:
    """The picture with cast shadows lifted from a part of it.

    A car's mask is not exact, and its dark rim is no shadow: there the matte is that of what is around.
    """
    rim = 2 * (rgb.shape[1] // 200) + 1
    judged = where & (cv2.dilate(body.astype(np.uint8), np.ones((rim, rim), np.uint8)) == 0)
    matte = shadow_matte(rgb, judged, sun)
    matte = np.where(judged, matte, where * masked_blur(matte, judged, rim / 2))
    return np.asarray(rgb * np.exp(matte[..., None] * sun.step), dtype=np.float32)


def _albedo(rgb: Image, sky: Mask, road: Mask, body: Mask, normal: Image) -> Image:
    road = _with_paint(rgb, road) & ~sky & ~body
    ground = ~sky
    other = ground & ~road
    sun = sunlight(rgb, road)
    free = _lifted(rgb, other & ~body, body, sun) if sun is not None and sun.certainty > 0 else rgb
    free = free / _colour_of_light(rgb, road, ground, sun)
    brightness = np.log(np.maximum(free @ LUMINANCE, 1e-3))
    if sun is not None:
        brightness[road] = sun.lit[0]
    strength = np.exp(brightness[ground].mean()) / GREY if ground.any() else 1.0
    free /= (strength * _sky_exposure(normal))[..., None]
    log_luminance = np.log(np.maximum(free @ LUMINANCE, 1e-3)).astype(np.float32)
    shading = SHADING_OTHER * (_slow(log_luminance, other) - np.log(GREY))
    albedo = free / np.exp(shading)[..., None]
    if sun is not None:
        albedo = np.where(road[..., None], ASPHALT * road_albedo(rgb, road, sun), albedo)
    albedo = np.clip(albedo, DARKEST, BRIGHTEST)
    albedo[sky] = 0
    return np.asarray(albedo, dtype=np.float32)


def materials(
    rgb_linear: Image, *, sky: Mask, road: Mask, vehicle: NDArray[np.int32], normal: Image
) -> dict[str, NDArray[np.float32]]:
    """Guess the materials of a frame; the module's first lines say how.

    Parameters
    ----------
    rgb_linear
        Recorded image, (H, W, 3) scene-linear Rec. 709.
    sky, road
        (H, W) masks.
    vehicle
        (H, W) instance ids, 0 = none.
    normal
        Unit normals, (H, W, 3), camera frame, facing the camera; the camera is taken for level.

    Returns
    -------
    `albedo` (H, W, 3), `roughness` and `metallic` (H, W), all float32 within [0, 1]. The sky has albedo 0.

    Raises
    ------
    InputError
        A plane has another size than the image.
    """
    size = rgb_linear.shape[:2]
    for name, plane in (("sky", sky), ("road", road), ("vehicle", vehicle), ("normal", normal)):
        if plane.shape[:2] != size:
            raise InputError(f"{name}: expected a plane of {size}, got {plane.shape}")
    body = vehicle > 0
    asphalt = road & ~body & ~sky
    roughness = np.full(size, ROUGHNESS_OTHER, dtype=np.float32)
    roughness[asphalt] = ROUGHNESS_ROAD
    roughness[body] = ROUGHNESS_VEHICLE
    return {
        "albedo": _albedo(rgb_linear, sky, asphalt, body, normal),
        "roughness": roughness,
        "metallic": np.zeros(size, dtype=np.float32),
    }
