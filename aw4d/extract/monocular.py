"""Depth of one picture from the height of the camera alone: a level road, and upright things that stand on it.

The crudest geometry that a weather pass can work with. Below the horizon all is ground that has the colours of road,
grass or earth; a region of other colours stands upright where its foot is. Above the horizon all is far.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from aw4d.camera import Camera
from aw4d.errors import InputError

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

FARTHEST_M = 150.0  # a wrong pitch of 0.3 degrees puts ground at 150 m anywhere between 95 and 360 m
NEAREST_M = 0.3
UNLIKE_ROAD = 14.0  # CIE Lab distance from the road's colour beyond which a pixel is not asphalt
SMALLEST = 0.015  # sides of the smallest thing, as a fraction of the picture's height
VEHICLE_HEIGHT_M = 2.0  # of things that reach the horizon
REACH = 4  # a thing reaches the horizon if it comes this near [px]


def ground_depth(camera: Camera, camera_height_m: float) -> Image:
    """z [m] of a level ground plane under the camera, (H, W); infinite at and above the horizon."""
    down = -(camera.rays() @ camera.camera_to_world[1, :3])
    with np.errstate(divide="ignore"):
        return np.where(down > 0, camera_height_m / np.maximum(down, 0), np.inf).astype(np.float32)


def _looks_like_ground(rgb: NDArray[np.uint8], ground: Image) -> Mask:
    """Asphalt by the colours just ahead, shadow and paint included, or the hues of grass and earth."""
    lab = cv2.cvtColor(cv2.GaussianBlur(rgb, (5, 5), 0).astype(np.float32) / np.float32(255), cv2.COLOR_RGB2LAB)
    width = rgb.shape[1]
    ahead = np.zeros(ground.shape, dtype=np.bool_)
    ahead[:, width // 3 : 2 * width // 3] = True
    ahead &= ground < 3 * ground.min()
    road = np.median(lab[ahead], axis=0)
    chroma = np.linalg.norm(lab[..., 1:] - road[1:], axis=-1)
    # Paint is brighter than asphalt and shadow darker, both of its hue; a black car is darker still.
    asphalt = (chroma < UNLIKE_ROAD) & (lab[..., 0] > 0.45 * road[0])
    verge = (lab[..., 2] > 8) & (lab[..., 1] < 0.6 * lab[..., 2])
    return np.asarray(asphalt | verge, dtype=np.bool_)


def _things(ground_like: Mask, below: Mask) -> NDArray[np.int32]:
    """Labels (H, W) of the regions below the horizon that look like no ground and are large enough, 0 = none."""
    size = max(3, round(SMALLEST * len(below)))
    kernel = np.ones((size, size), np.uint8)
    closed = cv2.morphologyEx((~ground_like & below).astype(np.uint8), cv2.MORPH_CLOSE, kernel)
    opened = cv2.morphologyEx(closed, cv2.MORPH_OPEN, kernel)
    return np.asarray(cv2.connectedComponents(opened)[1], dtype=np.int32)


def _columns(thing: Mask, below: Mask, height: Image, headroom_m: float) -> Mask:
    """A thing's pixels, continued above the horizon where it reaches it: nothing there shows where it ends."""
    reaches = thing & (np.cumsum(below, axis=0) <= REACH)
    above = ~below & (height < headroom_m) & reaches.any(axis=0)
    return np.asarray(thing | above, dtype=np.bool_)


def _stand_upright(ground: Image, things: NDArray[np.int32], camera: Camera, camera_height_m: float) -> Image:
    """Give each thing the depth of the ground at its foot."""
    below = ground < FARTHEST_M
    height_at_1m = camera.rays() @ camera.camera_to_world[1, :3]
    depth = ground.copy()
    for label in range(1, int(things.max()) + 1):
        thing = things == label
        foot = np.flatnonzero(thing.any(axis=1))[-1]
        z = float(np.median(ground[foot, thing[foot]]))
        own = _columns(thing, below, (height_at_1m * z).astype(np.float32), VEHICLE_HEIGHT_M - camera_height_m)
        depth[own] = np.minimum(depth[own], z)
    return depth


def monocular_depth(rgb: NDArray[np.uint8], *, camera: Camera, camera_height_m: float, sky: Mask) -> Image:
    """Depth of a picture over a level road.

    Parameters
    ----------
    rgb
        Recorded picture, (H, W, 3) sRGB uint8.
    camera
        The frame's camera; its pose gives pitch and roll.
    camera_height_m
        Height of the camera above the road [m].
    sky
        (H, W) mask.

    Returns
    -------
    (H, W) float32 [m], within [0.3, 150].

    Raises
    ------
    InputError
        The picture shows no ground.
    """
    ground = ground_depth(camera, camera_height_m)
    below = ground < FARTHEST_M
    if not below[-1].any():
        raise InputError("depth: expected a camera that sees the road, got one that looks above the horizon")
    things = _things(_looks_like_ground(rgb, ground), below & ~sky)
    depth = _stand_upright(ground, things, camera, camera_height_m)
    return np.clip(depth, NEAREST_M, FARTHEST_M).astype(np.float32)
