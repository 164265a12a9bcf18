"""Pinhole camera: intrinsics, pose, rays.

Camera frame: OpenCV (x right, y down, z forward), pixel centres at integer coordinates.
World frame: right-handed, y up, metres. Poses are camera-to-world, 4x4, float64.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aw4d.errors import InputError

Array = NDArray[np.float64]


def _finite_matrix(name: str, value: ArrayLike, shape: tuple[int, int]) -> Array:
    matrix = np.array(value, dtype=np.float64)
    if matrix.shape != shape or not np.isfinite(matrix).all():
        raise InputError(f"{name}: expected a finite {shape} matrix, got {matrix.tolist()}")
    matrix.setflags(write=False)
    return matrix


@dataclass(frozen=True, kw_only=True, eq=False)
class Camera:
    """One frame's pinhole camera.

    Parameters
    ----------
    width, height
        Image size [px].
    K
        Intrinsic matrix, 3x3 [px], no skew.
    camera_to_world
        Pose, 4x4, rotation orthonormal within 1e-4. By default the world is the camera's own frame.

    Raises
    ------
    InputError
        A matrix has another shape, is not finite, or does not describe a camera.
    """

    width: int
    height: int
    K: Array
    camera_to_world: Array = field(default_factory=lambda: np.eye(4))

    def __post_init__(self) -> None:
        K = _finite_matrix("K", self.K, (3, 3))
        if K[0, 0] <= 0 or K[1, 1] <= 0 or abs(K[0, 1]) > 1e-6 or not np.allclose(K[2], (0, 0, 1)):
            raise InputError(f"K: expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with fx, fy > 0, got {K.tolist()}")
        pose = _finite_matrix("camera_to_world", self.camera_to_world, (4, 4))
        R = pose[:3, :3]
        if not np.allclose(R @ R.T, np.eye(3), atol=1e-4) or np.linalg.det(R) < 0:
            raise InputError(f"camera_to_world: expected a rigid transform, got rotation {R.tolist()}")
        if self.width < 1 or self.height < 1:
            raise InputError(f"camera: expected a size of at least 1x1, got {self.width}x{self.height}")
        object.__setattr__(self, "K", K)
        object.__setattr__(self, "camera_to_world", pose)

    @property
    def shape(self) -> tuple[int, int]:
        """Shape of a plane, (height, width)."""
        return self.height, self.width

    @property
    def world_to_camera(self) -> Array:
        """Inverse pose, 4x4."""
        R, t = self.camera_to_world[:3, :3], self.camera_to_world[:3, 3]
        inverse = np.eye(4)
        inverse[:3, :3] = R.T
        inverse[:3, 3] = -R.T @ t
        return inverse

    def rays(self) -> Array:
        """Ray through every pixel centre, camera frame, scaled to z = 1; (H, W, 3)."""
        u, v = np.meshgrid(np.arange(self.width), np.arange(self.height))
        x = (u - self.K[0, 2]) / self.K[0, 0]
        y = (v - self.K[1, 2]) / self.K[1, 1]
        return np.stack([x, y, np.ones_like(x)], axis=-1)

    def unproject(self, depth: ArrayLike) -> Array:
        """Points in the camera frame [m], (H, W, 3), of a plane of z depth [m], (H, W)."""
        return self.rays() * np.asarray(depth, dtype=np.float64)[..., None]

    def project(self, points: ArrayLike) -> Array:
        """Pixel coordinates and depth (u [px], v [px], z [m]) of camera-frame points; (..., 3) to (..., 3).

        Points with z <= 0 lie behind the eye; their u and v are NaN.
        """
        p = np.asarray(points, dtype=np.float64)
        z = p[..., 2]
        safe = np.where(z > 0, z, np.nan)
        u = self.K[0, 0] * p[..., 0] / safe + self.K[0, 2]
        v = self.K[1, 1] * p[..., 1] / safe + self.K[1, 2]
        return np.stack([u, v, z], axis=-1)

    def to_world(self, points: ArrayLike) -> Array:
        """World coordinates of camera-frame points [m], (..., 3)."""
        return np.asarray(points, dtype=np.float64) @ self.camera_to_world[:3, :3].T + self.camera_to_world[:3, 3]

    def to_camera(self, points: ArrayLike) -> Array:
        """Camera-frame coordinates of world points [m], (..., 3)."""
        return (np.asarray(points, dtype=np.float64) - self.camera_to_world[:3, 3]) @ self.camera_to_world[:3, :3]
