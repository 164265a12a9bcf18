"""The faces of lamps as the camera sees them: discs whose flux stays however few pixels they cover."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from aw4d.camera import Camera
from aw4d.lights.light import Light
from aw4d.lights.photometry import on_picture
from aw4d.params import StreetLampParams

NEAREST = 0.5  # [m] of depth from which on a disc is drawn
POST = 0.6  # [m] that the lamp's own head and arm may lie before its middle

Array = NDArray[np.float64]
Shown = Callable[[tuple[NDArray[np.intp], ...], float], NDArray[np.bool_]]


def add_disc(
    out: NDArray[np.float32], centre: Array, radius_m: float, radiance: Sequence[float], camera: Camera, shown: Shown
) -> None:
    """Add a disc that faces the camera to (H, W, 3) radiance, in place.

    Its share of every pixel is analytic: a disc smaller than a pixel dims the pixel, and its flux stays.

    Parameters
    ----------
    out
        Radiance that is added to.
    centre
        Camera frame [m], (3,).
    radius_m
        [m].
    radiance
        (3,) linear on the picture's scale.
    camera
        The frame's camera.
    shown
        Says, for the rows and columns of a window (as `np.ix_` gives them) and the disc's depth [m], where it is seen.
    """
    if centre[2] <= NEAREST:
        return
    u, v, z = (float(c) for c in camera.project(centre))
    radius = radius_m * camera.K[0, 0] / z
    # At least a pixel wide, so that the share of the pixels varies smoothly as the lamp moves.
    drawn = max(radius, 0.75)
    half = math.ceil(drawn + 1)
    column = np.arange(math.floor(u) - half, math.floor(u) + half + 2)
    row = np.arange(math.floor(v) - half, math.floor(v) + half + 2)
    share = np.clip(drawn + 0.5 - np.hypot(column - u, row[:, None] - v), 0, 1)
    share = np.minimum(share * (math.pi * radius**2 / share.sum()), 1)
    across, down = (column >= 0) & (column < camera.width), (row >= 0) & (row < camera.height)
    window = np.ix_(row[down], column[across])
    seen = share[np.ix_(down, across)] * shown(window, z)
    out[window] += (seen[..., None] * np.asarray(radiance)).astype(np.float32)


def add_street_lamp_faces(
    out: NDArray[np.float32],
    lights: Sequence[Light],
    depth: NDArray[np.floating],
    sky: NDArray[np.bool_],
    camera: Camera,
    params: StreetLampParams,
    *,
    white_cd_m2: float,
) -> None:
    """Add the radiance of the street lamps' faces, in place, where nothing stands before them.

    Parameters
    ----------
    out
        (H, W, 3) radiance that is added to.
    lights
        Street lamps, in the world.
    depth, sky
        (H, W) [m], and where the depth means nothing.
    camera
        The frame's camera.
    params
        Size, luminance and colour of the faces.
    white_cd_m2
        The luminance that the picture shows as white.
    """
    radiance = on_picture(params.face_cd_m2, params.color, white_cd_m2)

    def shown(window: tuple[NDArray[np.intp], ...], z: float) -> NDArray[np.bool_]:
        return sky[window] | (depth[window] > z - POST)

    for light in lights:
        add_disc(out, camera.to_camera(light.position), params.face_radius_m, radiance, camera, shown)
