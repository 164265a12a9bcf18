"""One scale and bias for a whole recording whose depth is relative: from its laser returns or its camera's height."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aw4d.calibrate.align import align_depth
from aw4d.calibrate.ground import scale_from_camera_height
from aw4d.camera import Camera
from aw4d.errors import InputError
from aw4d.extract.visibility import visible_uvz
from aw4d.gbuffer import DEPTH_MAX, PLANES
from aw4d.io.source import Source

SAMPLED_FRAMES = 16
ROAD_POINTS = 4000  # a frame


@dataclass(frozen=True, kw_only=True)
class MetricDepth:
    """metric = scale * relative + bias [m], and a sentence on where the two numbers come from."""

    scale: float
    bias: float
    origin: str

    def apply(self, relative: NDArray[np.float32]) -> NDArray[np.float32]:
        """Depth [m] of a relative depth plane, (H, W)."""
        metric = self.scale * relative.astype(np.float64) + self.bias
        return np.clip(metric, PLANES["depth"].low, DEPTH_MAX).astype(np.float32)


def _depth(source: Source, index: int) -> NDArray[np.float32]:
    planes = source.planes(index)
    if "depth" not in planes:
        raise InputError(f"{source.info.name}: frame {index}: expected dense relative depth, got too few pixels of it")
    return np.asarray(planes["depth"], dtype=np.float32)


def _pairs(relative: NDArray[np.float32], points: NDArray[np.float32], camera: Camera) -> NDArray[np.float64]:
    """Relative depth and laser depth [m] of the pixels that returns hit, (n, 2)."""
    u, v, z = visible_uvz(points[:, :3], camera=camera).T
    return np.column_stack([relative[np.rint(v).astype(int), np.rint(u).astype(int)], z])


def _road(relative: NDArray[np.float32], camera: Camera) -> NDArray[np.float64]:
    """Points (n, 3), relative units, of the lowest third of the picture's middle: the road, or most of it."""
    height, width = camera.shape
    region = np.s_[2 * height // 3 :, width // 4 : 3 * width // 4]
    points = camera.unproject(relative)[region].reshape(-1, 3)
    return np.asarray(points[:: max(1, len(points) // ROAD_POINTS)], dtype=np.float64)


def metric_depth(source: Source) -> MetricDepth:
    """Fit scale and bias over frames from the whole recording; by camera height the bias is 0.

    Raises
    ------
    InputError
        Neither returns nor a camera height are there, or the fit fails (`align_depth`, `scale_from_camera_height`).
    """
    info = source.info
    chosen = np.unique(np.linspace(0, len(info) - 1, SAMPLED_FRAMES).astype(int)).tolist()
    scans = [source.points(index) for index in chosen]
    if all(scan is not None for scan in scans):
        pairs = np.concatenate(
            [
                _pairs(_depth(source, index), scan, info.camera(index))
                for index, scan in zip(chosen, scans, strict=True)
                if scan is not None
            ]
        )
        fit = align_depth(pairs[:, 0], pairs[:, 1], seed=0)
        origin = (
            f"relative depth aligned with laser returns: scale {fit.scale:.6g}, bias {fit.bias:.6g} m, "
            f"{fit.inliers} of {fit.pairs} pairs agree, RMSE {fit.rmse:.3g} m"
        )
        return MetricDepth(scale=fit.scale, bias=fit.bias, origin=origin)
    if source.camera_height_m is None:
        raise InputError(f"{info.name}: relative depth needs laser returns or the height of the camera, got neither")
    points = np.concatenate([_road(_depth(source, index), info.camera(index)) for index in chosen])
    up = info.camera(0).camera_to_world[1, :3]  # the world's y axis in the camera frame
    scale = scale_from_camera_height(points, camera_height_m=source.camera_height_m, up=up, seed=0)
    origin = f"relative depth scaled by the camera's height, {source.camera_height_m:g} m: scale {scale:.6g}"
    return MetricDepth(scale=scale, bias=0.0, origin=origin)
