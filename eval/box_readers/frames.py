"""What the readers of boxes share: names of frames, poses of frames, collecting."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import ArrayLike

from eval.boxes import Array, Box3D, Boxes
from eval.errors import MetricError


def frame_name(frame: object) -> str:
    """A frame's name; of a number, without leading zeros, so that files of different tools agree.

    >>> frame_name(12), frame_name("000012"), frame_name("ca9a28")
    ('12', '12', 'ca9a28')
    """
    name = str(frame).strip()
    return str(int(name)) if name.isdecimal() else name


def by_frame(boxes: Iterable[tuple[str, Box3D]]) -> Boxes:
    """Boxes with the names of their frames, collected by frame."""
    frames: dict[str, list[Box3D]] = {}
    for frame, box in boxes:
        frames.setdefault(frame, []).append(box)
    return {frame: tuple(found) for frame, found in frames.items()}


def inverse_pose(poses: Mapping[str, ArrayLike], frame: str) -> Array:
    """World-to-camera of a frame, (4, 4), from camera-to-world poses.

    Raises
    ------
    MetricError
        The frame has no pose, or it is not a matrix that can be inverted.
    """
    if frame not in poses:
        raise MetricError(f"expected a camera pose of frame {frame}, got poses of {len(poses)} other frames")
    return inverse(poses[frame])


def inverse(pose: ArrayLike) -> Array:
    """Inverse of a pose, (4, 4).

    Raises
    ------
    MetricError
        It is not a finite (4, 4) matrix that can be inverted.
    """
    matrix = np.asarray(pose, dtype=np.float64)
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all() or np.linalg.det(matrix) == 0:
        raise MetricError(f"pose: expected a finite (4, 4) matrix with an inverse, got {matrix.tolist()}")
    return np.asarray(np.linalg.inv(matrix), dtype=np.float64)
