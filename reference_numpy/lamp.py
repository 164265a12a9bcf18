"""Lamps: points and spots that light a stretch of the scene; the falloffs that every pass shares."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

DIRECTIONAL, POINT, SPOT = 0, 1, 2
EPSILON = 1e-4  # [m^2] paper's softening of 1/d^2: the square of a lamp's radius of 1 cm


class Lamp:
    """A point or spot light in the camera frame; a point has cos_outer = -1."""

    def __init__(self, position: Array, direction: Array, cos_inner: float, cos_outer: float, r_max: float) -> None:
        self.position = np.asarray(position, dtype=np.float64)
        axis = np.asarray(direction, dtype=np.float64)
        self.direction = axis / np.linalg.norm(axis)  # a float32 direction is unit to 1e-7 only
        self.cos_inner = float(cos_inner)
        self.cos_outer = float(cos_outer)
        self.r_max = float(r_max)

    def cone(self, cos_angle: Array) -> Array:
        """Angular falloff S, clamped to [0, 1] before squaring. Paper, eq. "light_pass"."""
        if self.cos_outer < 0:
            return np.ones_like(cos_angle)
        return np.clip((cos_angle - self.cos_outer) / (self.cos_inner - self.cos_outer), 0.0, 1.0) ** 2

    def window(self, r2: Array) -> Array:
        """Distance window W, clamped at 0 before squaring: no light returns beyond r_max."""
        return window(r2, self.r_max)


def window(r2: Array, reach: float) -> Array:
    """1 at no distance, 0 from `reach` on, smooth; of the squared distance."""
    return np.asarray(np.maximum(1 - (r2 / reach**2) ** 2, 0.0) ** 2, dtype=np.float64)


def lamp(
    index: int,
    *,
    light_kind: NDArray[np.int32],
    light_position: Array,
    light_direction: Array,
    light_cos_inner: Array,
    light_cos_outer: Array,
    light_r_max: Array,
) -> Lamp:
    """One of the lights that a pass was given, which must not be directional."""
    return Lamp(
        light_position[index],
        light_direction[index],
        light_cos_inner[index],
        light_cos_outer[index] if light_kind[index] == SPOT else -1.0,
        light_r_max[index],
    )
