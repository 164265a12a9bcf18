"""The built-in procedural street: a sunny street, drawn by ray casting, every plane of every frame exact.

The world's x axis runs along the road, in the way of the drive, y points up and z to the right; metres. The road's
surface is y = 0 and its middle z = 0. The camera drives 1 m a frame (10 m/s at 10 frames a second) in the right lane,
1.6 m above the road. The street is a loop of 240 m: frame n + 240 shows what frame n shows.

The surfaces that the planes tell of are exact at pixel centres. Fine textures (bricks, markings, grain) are averaged
over the pixel's footprint in `albedo`, and `rgb` is smoothed at edges; neither makes a surface where there is none.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from aw4d.boxes import Box
from aw4d.camera import Camera
from aw4d.errors import InputError
from aw4d.gbuffer import GBuffer
from aw4d.street import layout
from aw4d.street.render import SKY_DEPTH_M, planes, shadow_mask
from aw4d.street.sky import SUN

__all__ = ["FRAMES", "RATE", "SKY_DEPTH_M", "boxes", "camera", "frame", "lamps", "shadow", "sun_direction"]

FRAMES = 57
RATE = layout.RATE  # frames a second
_HEIGHT = 1.6  # of the camera above the road [m]
_PITCH = math.radians(1.2)  # upwards, so that roofs and sky come into view
_BOB = math.radians(0.12)
_BOB_FRAMES = 16  # divides the loop

sun_direction: NDArray[np.float64] = SUN.copy()
"""Unit vector towards the sun, world frame."""
sun_direction.setflags(write=False)


def camera(index: int, *, width: int = 1280, height: int = 704) -> Camera:
    """The camera of a frame.

    Parameters
    ----------
    index
        Number of the frame, from 0 on, without an end.
    width, height
        Size of the image [px]; the horizontal field of view is 58 degrees at any size.

    Raises
    ------
    InputError
        The index is negative, or the size is not at least 1x1.
    """
    if index < 0:
        raise InputError(f"street: expected a frame number from 0 on, got {index}")
    if width < 1 or height < 1:
        raise InputError(f"street: expected a size of at least 1x1, got {width}x{height}")
    f = 0.9 * width
    K = np.array([[f, 0, (width - 1) / 2], [0, f, (height - 1) / 2], [0, 0, 1]])
    pitch = _PITCH + _BOB * math.sin(2 * math.pi * (index % _BOB_FRAMES) / _BOB_FRAMES)
    pose = np.eye(4)
    pose[:3, 0] = 0, 0, 1
    pose[:3, 1] = math.sin(pitch), -math.cos(pitch), 0
    pose[:3, 2] = math.cos(pitch), math.sin(pitch), 0
    pose[:3, 3] = layout.ego_x(index), _HEIGHT, layout.EGO_Z
    return Camera(width=width, height=height, K=K, camera_to_world=pose)


def frame(index: int, *, width: int = 1280, height: int = 704) -> GBuffer:
    """All planes of a frame: a pure function of its arguments.

    `rgb` is scene-linear, sunlit plaster about 0.7. The sky's depth is `SKY_DEPTH_M`. The green lenses of the traffic
    lights are the only `emissive` surfaces.

    Parameters
    ----------
    index, width, height
        As in `camera`.

    Raises
    ------
    InputError
        As in `camera`.
    """
    return planes(index, camera(index, width=width, height=height))


def shadow(index: int, *, width: int = 1280, height: int = 704) -> NDArray[np.bool_]:
    """Where no sunlight falls on a frame's surfaces, (height, width).

    True where something stands between the pixel's surface and the sun, or the surface looks away from it; False in the
    sky. Exact at pixel centres.

    Raises
    ------
    InputError
        As in `camera`.
    """
    return shadow_mask(index, camera(index, width=width, height=height))


def boxes(index: int) -> list[Box]:
    """Boxes, exact to 2 mm, of all cars around the camera, parked and moving; the id in `vehicle` is `track_id` + 1."""
    return [
        Box(track_id=car.track - 1, category="car", object_to_world=car.object_to_world, size=car.size)
        for car in layout.cars(index)
    ]


def lamps() -> NDArray[np.float64]:
    """World positions of the street lamps' heads [m], (N, 3); row n is the lamp with id n + 1 in `street_light`."""
    return np.array(layout.lamp_heads())
