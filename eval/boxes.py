"""3D boxes of detectors and labels, in the frame of the camera that sees them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eval.errors import MetricError

Array = NDArray[np.float64]

# Signs along the box's own axes: a ring of four corners, then the four across from them in the same order.
_CORNERS = np.array([(x, y, z) for y in (1, -1) for x, z in ((1, 1), (1, -1), (-1, -1), (-1, 1))], dtype=np.float64)
_TOLERANCE = 1e-3  # of a box's size: corners in files are rounded

_KINDS = {
    "vehicle": "vehicle car van truck bus tram train trailer motorcycle construction construction_vehicle",
    "pedestrian": "pedestrian person person_sitting",
    "cyclist": "cyclist bicycle",
}
_KIND_OF = {name: kind for kind, names in _KINDS.items() for name in names.split()}


@dataclass(frozen=True, kw_only=True, eq=False)
class Camera:
    """Pinhole camera.

    Parameters
    ----------
    K
        Intrinsic matrix, (3, 3) [px].
    width, height
        Size of the picture [px].

    Raises
    ------
    MetricError
        K is not an intrinsic matrix, or the picture has no pixels.
    """

    K: Array
    width: int
    height: int

    def __post_init__(self) -> None:
        K = np.array(self.K, dtype=np.float64)
        if K.shape != (3, 3) or not np.isfinite(K).all() or min(K[0, 0], K[1, 1]) <= 0 or K[2].tolist() != [0, 0, 1]:
            raise MetricError(f"K: expected (3, 3) with positive focal lengths and last row 0 0 1, got {K.tolist()}")
        if self.width < 1 or self.height < 1:
            raise MetricError(f"camera: expected a picture of at least 1x1, got {self.width}x{self.height}")
        object.__setattr__(self, "K", K)


@dataclass(frozen=True, kw_only=True, eq=False)
class Box3D:
    """One object's box in one frame.

    Parameters
    ----------
    corners
        Camera frame (x right, y down, z forward), (8, 3) [m]: a ring of four corners of one face, then the four across
        from them in the same order, as KITTI's tools, Omni3D and OVMono3D have them.
    category
        What the file calls the object.
    track_id
        The same in every frame; None where the file has no identities.
    score
        Confidence of a detector; None for labels.

    Raises
    ------
    MetricError
        The corners are not eight finite points of a parallelepiped in this order.
    """

    corners: Array
    category: str
    track_id: str | None = None
    score: float | None = None

    def __post_init__(self) -> None:
        corners = np.array(self.corners, dtype=np.float64)
        if corners.shape != (8, 3) or not np.isfinite(corners).all():
            raise MetricError(f"corners: expected (8, 3) finite, in metres, got {corners.tolist()}")
        first, second = corners[:4], corners[4:]
        twist = max(
            np.abs(first[0] - first[1] + first[2] - first[3]).max(),
            np.abs((second - first) - (second - first)[0]).max(),
        )
        if twist > _TOLERANCE * max(1.0, float(np.ptp(corners, axis=0).max())):
            raise MetricError(
                f"corners: expected a ring of four, then the four across from them in the same order, got "
                f"{corners.tolist()}"
            )
        object.__setattr__(self, "corners", corners)


Boxes = dict[str, tuple[Box3D, ...]]  # by the frame's name; numbers have no leading zeros


def cuboid(box_to_camera: ArrayLike, size: ArrayLike) -> Array:
    """Corners of a box, (8, 3) [m], in the order of `Box3D.corners`.

    Parameters
    ----------
    box_to_camera
        Pose, (4, 4); its origin is the box's centre.
    size
        Lengths along the box's own x, y and z [m], positive.

    Raises
    ------
    MetricError
        The pose is not rigid, or a length is not positive.

    >>> cuboid(np.eye(4), (4, 2, 1))[[0, 6]].tolist()
    [[2.0, 1.0, 0.5], [-2.0, -1.0, -0.5]]
    """
    pose, lengths = np.asarray(box_to_camera, dtype=np.float64), np.asarray(size, dtype=np.float64)
    if pose.shape != (4, 4) or not np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=_TOLERANCE):
        raise MetricError(f"box: expected a rigid pose, (4, 4), got {pose.tolist()}")
    if lengths.shape != (3,) or not (np.isfinite(lengths) & (lengths > 0)).all():
        raise MetricError(f"box: expected three positive lengths in metres, got {lengths.tolist()}")
    return np.asarray((_CORNERS * lengths / 2) @ pose[:3, :3].T + pose[:3, 3], dtype=np.float64)


def kind(category: str) -> str:
    """One name for what data sets name differently: "vehicle", "pedestrian", "cyclist", else the category itself.

    KITTI's Van, nuScenes' vehicle.bus.rigid and Waymo's TYPE_VEHICLE are vehicles; so is a motorcycle, as in Waymo.

    >>> [kind(name) for name in ("Car", "TYPE_VEHICLE", "vehicle.bus.rigid", "vehicle.bicycle", "traffic_cone")]
    ['vehicle', 'vehicle', 'vehicle', 'cyclist', 'traffic_cone']
    """
    name = category.casefold().removeprefix("type_").replace(" ", "_")
    known = [_KIND_OF[part] for part in name.split(".") if part in _KIND_OF]
    return known[-1] if known else name
