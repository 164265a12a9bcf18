"""A made-up recording: a level road under a sky, whose planes are all known in closed form."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from aw4d.camera import Camera
from aw4d.clip import ClipInfo
from aw4d.colour import decode_srgb8
from aw4d.gbuffer import Plane
from aw4d.io.source import LEVEL, Source

CAMERA_HEIGHT = 1.5
FARTHEST = 60.0


def camera(width: int, height: int) -> Camera:
    K = np.array([[width, 0, (width - 1) / 2], [0, width, 0.4 * height], [0, 0, 1]])
    return Camera(width=width, height=height, K=K, camera_to_world=LEVEL)


def picture(width: int, height: int, index: int = 0) -> NDArray[np.uint8]:
    """Blue above the horizon, grey grain below, another in every frame."""
    rng = np.random.default_rng(index)
    image = np.empty((height, width, 3), np.uint8)
    image[:] = (110, 160, 240)
    below = ~sky(width, height)
    image[below] = 90 + rng.integers(0, 20, (np.count_nonzero(below), 1))
    return image


def sky(width: int, height: int) -> NDArray[np.bool_]:
    return np.broadcast_to((np.arange(height) < 0.4 * height)[:, None], (height, width)).copy()


def road_depth(width: int, height: int) -> NDArray[np.float32]:
    """z of the road [m], at most 60; 1 m under the sky, where no depth is told."""
    rows = camera(width, height).rays()[..., 1]
    depth = np.where(rows > 0, CAMERA_HEIGHT / np.maximum(rows, 1e-9), FARTHEST)
    return np.where(sky(width, height), 1.0, np.minimum(depth, FARTHEST)).astype(np.float32)


def planes(width: int, height: int, index: int) -> dict[str, Plane]:
    shape = (height, width)
    normal = np.zeros((*shape, 3), np.float32)
    normal[..., 1] = -1
    return {
        "depth": road_depth(width, height) + np.float32(index / 100),
        "normal": normal,
        "albedo": decode_srgb8(picture(width, height, index)),
        "roughness": np.full(shape, 0.5, np.float32),
        "metallic": np.zeros(shape, np.float32),
        "sky": sky(width, height),
        "road": ~sky(width, height),
        "vehicle": np.zeros(shape, np.int32),
    }


def points(width: int, height: int) -> NDArray[np.float32]:
    """Returns from a few hundred pixels of the road, (n, 4)."""
    rows, columns = np.nonzero(~sky(width, height))
    chosen = np.random.default_rng(0).choice(len(rows), 400)
    xyz = camera(width, height).unproject(road_depth(width, height))[rows[chosen], columns[chosen]]
    return np.column_stack([xyz, np.full(len(xyz), 0.3)]).astype(np.float32)


def info(frames: int, width: int, height: int) -> ClipInfo:
    return ClipInfo(
        name="made up",
        width=width,
        height=height,
        K=np.tile(camera(width, height).K, (frames, 1, 1)),
        camera_to_world=np.tile(LEVEL, (frames, 1, 1)),
        times=np.arange(frames) / 10,
        provenance={"rgb": "drawn"},
    )


def source(frames: int, width: int = 48, height: int = 32) -> Source:
    """All planes given."""
    return Source(
        info=info(frames, width, height),
        rgb=lambda index: picture(width, height, index),
        points=lambda index: points(width, height),
        planes=lambda index: planes(width, height, index),
        fingerprint="made up",
    )
