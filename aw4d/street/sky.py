"""Sky and sun: their radiance by direction, in units of the display's white."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from aw4d.street.noise import fractal_noise, smoothstep

Array = NDArray[Any]

# Behind the camera and to its left: it lights the right house fronts and the tails of the cars ahead.
_TOWARDS_SUN = np.array([-0.50, 0.66, -0.56])
SUN: NDArray[np.float64] = _TOWARDS_SUN / np.linalg.norm(_TOWARDS_SUN)
SUN_COLOUR = np.array([1.00, 0.93, 0.80], np.float32) * 1.30  # white plaster square to the sun comes out just below 1
ZENITH = np.array([0.10, 0.24, 0.60], np.float32)
HORIZON = np.array([0.60, 0.72, 0.86], np.float32)
STREET = np.array([0.22, 0.20, 0.18], np.float32)  # what a mirror sees below the roofs


def clear_sky(up: Array) -> Array:
    """Radiance without clouds of directions with the given height, (N,) to (3, N)."""
    blend = np.clip(up, 0, 1) ** 0.55
    return HORIZON[:, None] + blend * (ZENITH - HORIZON)[:, None]


def sky(direction: Array) -> Array:
    """Radiance of unit directions in the world, (3, N) to (3, N): clear sky with fair-weather clouds.

    The clouds lie on a plane far above, which bends away near the horizon so that they do not grow endlessly thin.
    """
    x, up, z = direction
    lift = 1 / (np.maximum(up, 0) + 0.10)
    u, v = x * lift * 0.9, z * lift * 0.9
    body = fractal_noise(u + 3.1, v + 0.4, 5, seed=11)
    thickness = smoothstep(0.47, 0.72, body) * smoothstep(0.0, 0.10, up)
    shade = fractal_noise(u + 3.16, v + 0.45, 3, seed=11)  # the same cloud a little towards the sun
    bright = 0.86 + 0.5 * np.clip(body - shade, -0.25, 0.25)
    cloud = np.stack([bright, bright * 0.995, bright * 0.985])
    return clear_sky(up) * (1 - thickness) + cloud * thickness


def mirrored(direction: Array) -> Array:
    """Radiance that a glossy surface sees in unit directions, (3, N): sky above a line of roofs, street below."""
    x, up, z = direction
    roofs = 0.22 + 0.10 * np.sin(7 * x + 3 * z) * np.cos(5 * z)
    above = smoothstep(-0.06, 0.06, up - roofs * np.sqrt(np.maximum(0, 1 - x * x)))
    return clear_sky(up) * above + STREET[:, None] * (1 - above) * (0.6 + 0.4 * smoothstep(-0.3, 0.3, up))


def ambient(normal: Array) -> Array:
    """Light of the sky and of the sunlit ground on unit normals in the world, times albedo; (3, N) to (3, N)."""
    up = 0.5 + 0.5 * normal[1]
    above = np.array([0.27, 0.33, 0.42], np.float32)[:, None]
    below = np.array([0.14, 0.125, 0.105], np.float32)[:, None]
    return below + (above - below) * up
