"""Where the surfaces of one frame are: what metrics that know geometry are given beside the pictures."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from eval.errors import MetricError

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """Geometry of one frame. Camera frame: x right, y down, z ahead; pixel centres at whole numbers.

    Parameters
    ----------
    depth
        (H, W) z of the surfaces [m], finite and > 0 but where `sky` is.
    K
        (3, 3) intrinsic matrix [px], no skew.
    camera_to_world
        (4, 4) pose, rigid.
    sky
        (H, W) True where there is no surface.
    moving
        (H, W) True on what moves by itself, vehicles and people.

    Raises
    ------
    MetricError
        A plane has another shape, or depth or camera have values that cannot be.
    """

    depth: NDArray[np.floating]
    K: Array
    sky: NDArray[np.bool_]
    moving: NDArray[np.bool_]
    camera_to_world: Array = field(default_factory=lambda: np.eye(4))

    def __post_init__(self) -> None:
        if self.depth.ndim != 2 or not self.depth.size:
            raise MetricError(f"depth: expected (H, W) in metres, got {self.depth.shape}")
        for name in ("sky", "moving"):
            if getattr(self, name).shape != self.depth.shape or getattr(self, name).dtype != np.bool_:
                plane = getattr(self, name)
                raise MetricError(f"{name}: expected {self.depth.shape} bool, got {plane.shape} {plane.dtype.name}")
        wrong = ~(np.isfinite(self.depth) & (self.depth > 0)) & ~self.sky
        if wrong.any():
            count = np.count_nonzero(wrong)
            raise MetricError(f"depth: expected finite metres > 0 off the sky, got {count} pixels that are not")
        for name, shape in (("K", (3, 3)), ("camera_to_world", (4, 4))):
            if getattr(self, name).shape != shape or not np.isfinite(getattr(self, name)).all():
                raise MetricError(f"{name}: expected a finite {shape} matrix, got {getattr(self, name).tolist()}")

    @property
    def shape(self) -> tuple[int, int]:
        """(H, W) of the planes."""
        height, width = self.depth.shape
        return height, width

    def rays(self) -> Array:
        """Ray through every pixel centre, camera frame, scaled to z = 1; (H, W, 3)."""
        height, width = self.shape
        out = np.ones((height, width, 3))
        out[..., 0] = (np.arange(width) - self.K[0, 2]) / self.K[0, 0]
        out[..., 1] = ((np.arange(height) - self.K[1, 2]) / self.K[1, 1])[:, None]
        return out

    def ranges(self) -> Array:
        """Distance of the surfaces from the camera along the ray [m], (H, W)."""
        rays = self.rays()
        return np.asarray(self.depth * np.sqrt(np.einsum("...c,...c->...", rays, rays)))

    def check(self, name: str, picture: NDArray[np.uint8]) -> None:
        """A picture of this view.

        Raises
        ------
        MetricError
            It has another size.
        """
        if picture.shape[:2] != self.shape:
            raise MetricError(f"{name}: expected a picture of the depth's size {self.shape}, got {picture.shape[:2]}")
