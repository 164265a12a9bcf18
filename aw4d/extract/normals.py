"""Surface normals of a depth map: smooth on surfaces, crisp between them.

Over the image a plane has linear inverse depth, 1/z = a x + b y + c with ray (x, y, 1), and (a, b, c) is its normal
over its distance from the eye. The three parameters are measured at every pixel from the gradient of inverse depth
and averaged over what belongs to the same surface: on a plane of any slant they are constant, so the window may be as
large as the surface and the scan lines average out.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from aw4d.camera import Camera
from aw4d.errors import InputError
from aw4d.extract.smoothing import smooth

Array = NDArray[np.float64]

GRAZING = 0.3
PRIOR = 1e-3
REACH = 0.5  # [m] on the surface, facing the eye, over which a normal is averaged
COARSE = 8.0
REACH_LIMITS = (15.0, 60.0)  # [px]
STEP = 0.01  # relative bend of inverse depth over one pixel that separates surfaces
CREASE = 0.05  # [rad] turn of the normal over one pixel that separates surfaces


def _bend(inverse: Array, axis: int) -> Array:
    """Affinity of neighbours along `axis`, 0 to 1: low where inverse depth is not linear from one to the next."""
    q = np.moveaxis(inverse, axis, 0)
    bend = np.zeros_like(q)
    bend[1:-1] = np.abs(q[2:] - 2 * q[1:-1] + q[:-2]) / q[1:-1]
    weight = np.exp(-((np.minimum(bend[1:], bend[:-1]) / STEP) ** 2))
    return np.moveaxis(weight, 0, axis)


def _slope(inverse: Array, affinity: Array, axis: int) -> tuple[Array, Array]:
    """Derivative of inverse depth per pixel along `axis`, and the smaller affinity to the two neighbours."""
    q, w = np.moveaxis(inverse, axis, 0), np.moveaxis(affinity, axis, 0)
    step = np.pad(np.diff(q, axis=0), ((1, 1), (0, 0)), mode="edge")
    w = np.pad(w, ((1, 1), (0, 0)), mode="edge")
    slope, trust = (step[1:] + step[:-1]) / 2, np.minimum(w[1:], w[:-1])
    return np.moveaxis(slope, 0, axis), np.moveaxis(trust, 0, axis)


def _turn(normal: Array, axis: int) -> Array:
    """Affinity of neighbours along `axis`, 0 to 1: low where the normal turns."""
    turn2 = (np.diff(normal, axis=axis) ** 2).sum(axis=-1)
    return np.asarray(np.exp(-turn2 / CREASE**2))


def _unit(plane: Array, rays: Array) -> Array:
    """Unit normals that face the eye, of plane parameters (H, W, 3)."""
    facing = np.where((plane * rays).sum(axis=-1, keepdims=True) > 0, -plane, plane)
    return np.asarray(facing / np.maximum(np.linalg.norm(facing, axis=-1, keepdims=True), 1e-12))


def _pairs(values: Array, axis: int) -> Array:
    """Smaller of neighbours along `axis`."""
    v = np.moveaxis(values, axis, 0)
    return np.moveaxis(np.minimum(v[1:], v[:-1]), 0, axis)


def normals_from_depth(
    depth: NDArray[np.float32], *, camera: Camera, sky: NDArray[np.bool_]
) -> NDArray[np.float32]:
    inverse = 1 / depth.astype(np.float64)
    rays = camera.rays()
    solid = ~sky
    across = _bend(inverse, 1) * (solid[:, 1:] == solid[:, :-1])
    down = _bend(inverse, 0) * (solid[1:] == solid[:-1])
    a, trust_a = _slope(inverse, across, 1)
    b, trust_b = _slope(inverse, down, 0)
    a, b = a * camera.K[0, 0], b * camera.K[1, 1]
    plane = np.stack([a, b, inverse - a * rays[..., 0] - b * rays[..., 1]], axis=-1)
    trust = np.minimum(trust_a, trust_b) * solid
    grazing = inverse / np.linalg.norm(plane, axis=-1) / np.linalg.norm(rays, axis=-1)
    ground = np.abs(plane[..., 1]) > 0.7 * np.linalg.norm(plane, axis=-1)
    trust *= np.where(ground, 1, np.minimum(grazing / GRAZING, 1) ** 4)
    plane *= (trust / np.linalg.norm(plane, axis=-1))[..., None]
    plane[..., 2] += PRIOR
    reach = np.clip(REACH * camera.K[0, 0] * inverse, *REACH_LIMITS) ** 2
    coarse = _unit(smooth(plane, across=COARSE**2 * across, down=COARSE**2 * down), rays)
    across *= _pairs(reach, 1)
    down *= _pairs(reach, 0)
    plane = smooth(plane, across=across * _turn(coarse, 1), down=down * _turn(coarse, 0))
    normal = _unit(plane, rays)
    normal[sky] = -rays[sky] / np.linalg.norm(rays[sky], axis=-1, keepdims=True)
    return normal.astype(np.float32)
