"""Ground plane in the camera frame, and the metric scale that a known camera height gives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aw4d.errors import InputError

Array = NDArray[np.float64]

HYPOTHESES = 400  # planes tried: finds three inliers with probability 1 - 4e-6 where 70 % are outliers
TOLERANCE = 0.04  # largest distance of an inlier from the plane, as a fraction of the camera's height above it
SAMPLES = 3000  # points that vote
FEWEST = 0.2  # share of the points under which there is no ground
STEEPEST = np.deg2rad(30.0)  # largest angle between the plane's normal and up


@dataclass(frozen=True, kw_only=True, eq=False)
class GroundPlane:
    """Plane normal . p + offset = 0, in the units of the points it was fitted to.

    Parameters
    ----------
    normal
        Unit normal, (3,), camera frame, upwards.
    offset
        Height of the camera above the plane, positive.
    inliers
        Share of the points on the plane, 0 to 1.
    """

    normal: Array
    offset: float
    inliers: float

    def height(self, points: ArrayLike) -> Array:
        """Signed height above the plane of camera-frame points, (..., 3) to (...)."""
        return np.asarray(np.asarray(points, dtype=np.float64) @ self.normal + self.offset, dtype=np.float64)


def _planes(points: Array, rng: np.random.Generator, up: Array) -> tuple[Array, Array]:
    """Upward normals (M, 3) and offsets (M,) of the planes through random triples, collinear ones left out."""
    a, b, c = points[rng.integers(len(points), size=(3, HYPOTHESES))]
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=-1)
    # The sine of the angle at a, so that "collinear" does not depend on the unit.
    sine = length / np.maximum(np.linalg.norm(b - a, axis=-1) * np.linalg.norm(c - a, axis=-1), np.finfo(float).tiny)
    proper = sine > 1e-3
    normals = normals[proper] / length[proper, None]
    normals[normals @ up < 0] *= -1
    return normals, -np.einsum("ij,ij->i", normals, a[proper])


def _votes(normals: Array, offsets: Array, points: Array) -> Array:
    """Support of each plane: a point votes by 1 - (distance / tolerance)^2, never below 0 (Torr and Zisserman 2000).

    A plain count would let a tilted plane win that grazes both the road and the verge beside it.
    """
    deviation = (points @ normals.T + offsets) / np.maximum(TOLERANCE * np.abs(offsets), np.finfo(float).tiny)
    return np.asarray(np.maximum(1 - deviation**2, 0).sum(axis=0), dtype=np.float64)


def _refine(normal: Array, offset: float, points: Array) -> tuple[Array, float]:
    """Total least squares on the inliers, until they settle."""
    for _ in range(5):
        inlier = np.abs(points @ normal + offset) <= TOLERANCE * offset
        centre = points[inlier].mean(axis=0)
        centred = points[inlier] - centre
        fitted = np.linalg.eigh(centred.T @ centred)[1][:, 0]
        normal = fitted if fitted @ normal > 0 else -fitted
        offset = float(-normal @ centre)
    return normal, offset


def _checked(points: ArrayLike, up: ArrayLike) -> tuple[Array, Array]:
    p = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    p = p[np.isfinite(p).all(axis=-1) & (np.linalg.norm(p, axis=-1) > 0)]
    direction = np.asarray(up, dtype=np.float64)
    if direction.shape != (3,) or not np.isfinite(direction).all() or not direction.any():
        raise InputError(f"up: expected a direction (3,) in the camera frame, got {np.asarray(up).tolist()}")
    if len(p) < 10:
        raise InputError(f"ground: expected at least 10 points, got {len(p)}")
    return p, direction / np.linalg.norm(direction)


def fit_ground(points: ArrayLike, *, up: ArrayLike, seed: int) -> GroundPlane:
    """Fit the ground plane by RANSAC (Fischler and Bolles 1981), then least squares on its inliers.

    Distances from the plane count relative to the camera's height above it, so the unit of the points does not
    matter, and a kerb (a decimetre) is told from the road.

    Parameters
    ----------
    points
        Points in the camera frame, (N, 3), in metres or in any other unit; points that are not finite are left out.
    up
        Upwards in the camera frame, (3,); a level camera has (0, -1, 0).
    seed
        Of the sampling.

    Raises
    ------
    InputError
        There are fewer than 10 points, no plane holds a fifth of them, or the plane that does lies above the camera
        or is inclined by more than 30 degrees.
    """
    p, direction = _checked(points, up)
    rng = np.random.default_rng(seed)
    voters = p[rng.choice(len(p), SAMPLES, replace=False)] if len(p) > SAMPLES else p
    normals, offsets = _planes(voters, rng, direction)
    if not len(normals):
        raise InputError("ground: expected points that span a plane, got points on one line")
    votes = _votes(normals, offsets, voters)
    cosine = normals @ direction
    level = (cosine >= np.cos(STEEPEST)) & (offsets > 0)
    best = int(np.argmax(np.where(level, votes, -1)))
    if not level[best] or votes[best] < FEWEST * len(voters):
        raise InputError(_refusal(votes, cosine, len(voters)))
    normal, offset = _refine(normals[best], float(offsets[best]), p)
    if normal @ direction < np.cos(STEEPEST) or offset <= 0:
        raise InputError(_refusal(votes, cosine, len(voters)))
    on_plane = np.abs(p @ normal + offset) <= TOLERANCE * offset
    return GroundPlane(normal=normal, offset=offset, inliers=float(on_plane.mean()))


def _refusal(votes: Array, cosine: Array, count: int) -> str:
    best = int(np.argmax(votes))
    angle = np.rad2deg(np.arccos(np.clip(cosine[best], -1, 1)))
    share = votes[best] / count
    return (
        f"ground: expected a plane below the camera, within 30 degrees of level, that holds {FEWEST:.0%} of the "
        f"points; the best plane is inclined by {angle:.0f} degrees and holds {share:.0%} of {count} points"
    )


def scale_from_camera_height(points_rel: ArrayLike, *, camera_height_m: float, up: ArrayLike, seed: int) -> float:
    """Metres in one unit of a relative reconstruction: the known camera height over the one in the reconstruction.

    Parameters
    ----------
    points_rel
        Road points in the camera frame, (N, 3), relative units.
    camera_height_m
        Height of the camera above the road [m], positive.
    up, seed
        As in `fit_ground`.

    Raises
    ------
    InputError
        The height is not positive, or there is no ground plane (`fit_ground`).
    """
    if not (np.isfinite(camera_height_m) and camera_height_m > 0):
        raise InputError(f"camera_height_m: expected a positive height in metres, got {camera_height_m}")
    return camera_height_m / fit_ground(points_rel, up=up, seed=seed).offset
