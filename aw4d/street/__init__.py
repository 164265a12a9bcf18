"""The built-in procedural street."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from aw4d.camera import Camera
from aw4d.gbuffer import GBuffer
from aw4d.street import layout
from aw4d.street.render import SKY_DEPTH_M, full_shot, light, planes

FRAMES = 57
CAMERA_HEIGHT = 1.6


def camera(index: int, *, width: int = 1280, height: int = 704) -> Camera:
    f = 0.9 * width
    K = np.array([[f, 0, (width - 1) / 2], [0, f, (height - 1) / 2], [0, 0, 1]])
    pitch = math.radians(1.2) + math.radians(0.12) * math.sin(2 * math.pi * index / 16)
    right, ahead = np.array([0.0, 0.0, 1.0]), np.array([math.cos(pitch), math.sin(pitch), 0.0])
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 2] = right, ahead
    pose[:3, 1] = np.cross(ahead, right)
    pose[:3, 3] = layout.ego_x(index), CAMERA_HEIGHT, layout.EGO_Z
    return Camera(width=width, height=height, K=K, camera_to_world=pose)


def frame(index: int, *, width: int = 1280, height: int = 704) -> GBuffer:
    shot = full_shot(index, camera(index, width=width, height=height))
    return planes(shot, light(shot), index / layout.RATE)
