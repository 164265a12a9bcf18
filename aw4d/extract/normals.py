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
from aw4d.extract.planes import affinity, local_planes
from aw4d.extract.smoothing import smooth

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

COARSE = 6.0  # [px] reach of the first average, from which creases are found
REACH = 0.4  # [m] reach of the second average on a surface that faces the eye
REACH_LIMITS = (15.0, 60.0)  # [px]
CREASE = 0.06  # [rad] turn of the normal over one pixel that separates surfaces
GROUND_CREASE = 0.02  # [rad] the same between surfaces that face up: the ground is flat, and low light shows its slants
UPWARD = 0.7  # cosine to the vertical of a surface that faces up
GRAZING = 0.3  # cosine to the view; what is steeper and not ground is rather the ramp between two surfaces
FACING = 1e-3  # weight of a normal that faces the camera, for where there is no other
# Where depth is guessed, a crown is the likeliest surface: its outside faces the eye and up (tangent of the tilt).
GUESS, TILT = 0.02, 0.6


def _turn(normal: Array, axis: int) -> Array:
    """Affinity of neighbours along `axis`, 0 to 1: low where the normal turns."""
    turn2 = (np.diff(normal, axis=axis) ** 2).sum(axis=-1)
    flat = _pairs(np.abs(normal[..., 1]), axis) > UPWARD
    return np.asarray(np.exp(-turn2 / np.where(flat, GROUND_CREASE, CREASE) ** 2))


def _unit(plane: Array, rays: Array) -> Array:
    """Unit normals that face the eye, of plane parameters (H, W, 3)."""
    facing = np.where((plane * rays).sum(axis=-1, keepdims=True) > 0, -plane, plane)
    return np.asarray(facing / np.maximum(np.linalg.norm(facing, axis=-1, keepdims=True), 1e-12))


def _pairs(values: Array, axis: int) -> Array:
    """Smaller of neighbours along `axis`."""
    v = np.moveaxis(values, axis, 0)
    return np.moveaxis(np.minimum(v[1:], v[:-1]), 0, axis)


def _believe(plane: Array, inverse: Array, rays: Array) -> Array:
    """How far planes (H, W, 3) are to be believed by their slant, (H, W), 0 to 1.

    The face of a kerb is narrower than the rings are apart: what faces up counts by how level it is. Any other
    surface seen at a grazing angle is rather the ramp that interpolation leaves between two surfaces.
    """
    length = np.linalg.norm(plane, axis=-1)
    upward = np.abs(plane[..., 1]) / length
    facing = inverse / length / np.linalg.norm(rays, axis=-1)
    level = np.maximum((upward - UPWARD) / (1 - UPWARD), 0.1) ** 4
    return np.asarray(np.where(upward > UPWARD, level, np.minimum(facing / GRAZING, 1) ** 4))


def _both(mask: Mask, axis: int) -> Mask:
    """Neighbours along `axis` that are both in the mask."""
    m = np.moveaxis(mask, axis, 0)
    return np.asarray(np.moveaxis(m[1:] & m[:-1], 0, axis))


def normals_from_depth(
    depth: NDArray[np.float32], *, camera: Camera, sky: Mask, guessed: Mask | None = None
) -> NDArray[np.float32]:
    """Unit normals of the surfaces in a depth map.

    Two passes: a short average of the local planes shows where the normal turns; a long one, in metres on the
    surface, stops there and at depth steps.

    Parameters
    ----------
    depth
        (H, W) z [m], > 0.
    camera
        The frame's camera.
    sky
        (H, W), pixels without a surface; their normal faces the camera.
    guessed
        (H, W), where the depth is no measure of the surface's shape: normals go on from beside, and fade to those of a
        crown of leaves, which face the camera and up. None: nowhere.

    Returns
    -------
    NDArray[np.float32]
        (H, W, 3), camera frame, unit length, facing the camera.

    Raises
    ------
    InputError
        A shape or dtype is wrong, or a depth is not finite and positive.
    """
    if depth.shape != camera.shape or not (np.isfinite(depth) & (depth > 0)).all():
        raise InputError(f"depth: expected {camera.shape} finite and positive in metres, got shape {depth.shape}")
    if sky.shape != camera.shape or sky.dtype != np.bool_:
        raise InputError(f"sky: expected {camera.shape} bool, got {sky.shape} {sky.dtype.name}")
    inverse, rays = 1 / depth.astype(np.float64), camera.rays()
    across = affinity(inverse, 1) * (sky[:, 1:] == sky[:, :-1])
    down = affinity(inverse, 0) * (sky[1:] == sky[:-1])
    plane, trust = local_planes(inverse, rays, camera.K[[0, 1], [0, 1]], across=across, down=down)
    trust *= _believe(plane, inverse, rays) * ~sky
    evidence = plane * (trust / np.linalg.norm(plane, axis=-1))[..., None]
    evidence[..., 2] += FACING
    if guessed is not None:
        # A step in a depth that is guessed, such as between two columns that go on upwards, is no border.
        guessed = guessed & ~sky
        evidence[guessed] = GUESS * np.array([0.0, TILT, 1.0])
        across[_both(guessed, 1)], down[_both(guessed, 0)] = 1, 1

    coarse = _unit(smooth(evidence, across=COARSE**2 * across, down=COARSE**2 * down), rays)
    reach2 = np.clip(REACH * camera.K[0, 0] * inverse, *REACH_LIMITS) ** 2
    across *= _pairs(reach2, 1) * _turn(coarse, 1)
    down *= _pairs(reach2, 0) * _turn(coarse, 0)
    normal = _unit(smooth(evidence, across=across, down=down), rays)
    normal[sky] = -rays[sky] / np.linalg.norm(rays[sky], axis=-1, keepdims=True)
    return normal.astype(np.float32)
