"""Albedo, roughness and metallic of one frame by kind of surface and picture statistics.

Approximations, in the order in which they are made:

- the road is grey asphalt, which tells the colour of the light; the geometric mean of all that is not sky is taken
  for an average grey, which tells its strength (steadier than the road, which passes in and out of shadow);
- light comes from a uniform sky and from the ground below it, so a wall is lit less than a road;
- what varies slowly over the picture, in log brightness, is light: nearly all of it on the road, which is asphalt of
  one reflectance, and half of it elsewhere;
- roughness depends on the kind of surface alone, and nothing is a bare metal: car paint has a clear dielectric coat.

Shadows with hard edges stay in the albedo, less deep than in the picture.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from aw4d.errors import InputError

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

ASPHALT = 0.12  # reflectance of worn asphalt (Akbari et al. 2001 give 0.05 to 0.15 over its age)
GREY = 0.15  # geometric mean reflectance of a street scene: foliage, grass, walls, asphalt
GROUND_BOUNCE = 0.2  # share of the sky's light that comes back from the ground
DARKEST, BRIGHTEST = 0.02, 0.9  # reflectances between which outdoor surfaces lie
SHADING_ROAD, SHADING_OTHER = 0.85, 0.5  # share of slow variation in log brightness that is taken for light
EDGE_VARIANCE = 0.5  # variance of log brightness within a window above which an edge is kept
ROUGHNESS_ROAD, ROUGHNESS_VEHICLE, ROUGHNESS_OTHER = 0.9, 0.35, 0.8
LUMINANCE = np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)  # Rec. 709


def _light(rgb: Image, road: Mask, ground: Mask) -> Image:
    """Light on a level surface, (3,): colour by the road, or the whole ground where there is little of it."""
    if not ground.any():
        return np.ones(3, dtype=np.float32)
    region = road if np.count_nonzero(road) >= 0.005 * road.size else ground
    # The arithmetic mean is led by what the sun lights, and so keeps its colour when a shadow falls on the road.
    colour = np.maximum(rgb[region].mean(axis=0), 1e-4)
    strength = np.exp(np.log(np.maximum(rgb[ground] @ LUMINANCE, 1e-3)).mean()) / GREY
    return np.asarray(colour / (colour @ LUMINANCE) * strength, dtype=np.float32)


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


def _albedo(rgb: Image, sky: Mask, road: Mask, normal: Image) -> Image:
    exposed = rgb / _light(rgb, road, ~sky) / np.where(road, np.float32(1), _sky_exposure(normal))[..., None]
    log_luminance = np.log(np.maximum(exposed @ LUMINANCE, 1e-3)).astype(np.float32)
    on_road = SHADING_ROAD * (_slow(log_luminance, road) - np.log(ASPHALT))
    elsewhere = SHADING_OTHER * (_slow(log_luminance, ~sky & ~road) - np.log(GREY))
    shading = np.exp(np.where(road, on_road, elsewhere))
    albedo = np.clip(exposed / shading[..., None], DARKEST, BRIGHTEST)
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
        "albedo": _albedo(rgb_linear, sky, asphalt, normal),
        "roughness": roughness,
        "metallic": np.zeros(size, dtype=np.float32),
    }
