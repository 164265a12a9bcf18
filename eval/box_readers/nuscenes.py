"""nuScenes-style JSON (Caesar et al. 2020): boxes of samples as in the detection and tracking challenges."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from eval.box_readers.frames import by_frame, frame_name, inverse_pose
from eval.boxes import Array, Box3D, Boxes, cuboid
from eval.errors import MetricError
from eval.text_files import entry, read_json

CATEGORY = ("detection_name", "tracking_name", "category_name")
IDENTITY = ("tracking_id", "instance_token")
SCORE = ("detection_score", "tracking_score")
KEYS = "an object with translation, size (w, l, h), rotation (w, x, y, z) and a name"


def read_nuscenes(path: Path, camera_to_world: Mapping[str, ArrayLike] | None = None) -> Boxes:
    """Boxes of a results file: {"results": {sample: [box, …]}}; a frame's name is its sample's.

    Of a box are read: `translation`, its centre [m]; `size`, width, length, height [m]; `rotation`, the quaternion w,
    x, y, z from the box's axes (x forward, y left, z up) to those of `translation`; one of `detection_name`,
    `tracking_name`, `category_name`; and, if there, `tracking_id` or `instance_token`, `detection_score` or
    `tracking_score`.

    Parameters
    ----------
    path
        Results file.
    camera_to_world
        Pose of each sample's camera in the frame of `translation`, (4, 4), camera axes OpenCV; None: the boxes are in
        the camera frame.

    Raises
    ------
    MetricError
        The file or an entry is not what is expected, or a sample has no pose.
    """
    return boxes_of_nuscenes(read_json(path), camera_to_world, path)


def boxes_of_nuscenes(results: Any, camera_to_world: Mapping[str, ArrayLike] | None, source: Path) -> Boxes:
    """Boxes of what a results file holds; see `read_nuscenes`. `source` is named in errors."""
    if not isinstance(results, dict) or not isinstance(results.get("results"), dict):
        raise MetricError(f'{source}: expected an object with "results", lists of boxes by sample')
    boxes = []
    for sample, found in results["results"].items():
        frame = frame_name(sample)
        with entry(source, f"sample {sample}", "a list of boxes"):
            to_camera = np.eye(4) if camera_to_world is None else inverse_pose(camera_to_world, frame)
            items = list(enumerate(found))
        for number, item in items:
            with entry(source, f"sample {sample}, box {number}", KEYS):
                boxes.append((frame, _box(item, to_camera)))
    return by_frame(boxes)


def _box(item: Mapping[str, Any], to_camera: Array) -> Box3D:
    width, length, height = (float(value) for value in item["size"])
    pose = np.eye(4)
    pose[:3, :3] = _rotation(item["rotation"])
    pose[:3, 3] = item["translation"]
    name = _first(item, CATEGORY)
    if name is None:
        raise MetricError(f"expected one of {', '.join(CATEGORY)}, got {sorted(item)}")
    identity, score = _first(item, IDENTITY), _first(item, SCORE)
    return Box3D(
        corners=cuboid(to_camera @ pose, (length, width, height)),
        category=str(name),
        track_id=None if identity is None else str(identity),
        score=None if score is None else float(score),
    )


def _first(item: Mapping[str, Any], names: tuple[str, ...]) -> Any:
    return next((item[name] for name in names if item.get(name) is not None), None)


def _rotation(quaternion: Any) -> Array:
    w, x, y, z = (float(value) for value in quaternion)
    norm = w * w + x * x + y * y + z * z
    if abs(norm - 1) > 1e-3:
        raise MetricError(f"rotation: expected a unit quaternion (w, x, y, z), got {quaternion}")
    twice = 2 / norm
    return np.array(
        [
            [1 - twice * (y * y + z * z), twice * (x * y - w * z), twice * (x * z + w * y)],
            [twice * (x * y + w * z), 1 - twice * (x * x + z * z), twice * (y * z - w * x)],
            [twice * (x * z - w * y), twice * (y * z + w * x), 1 - twice * (x * x + y * y)],
        ]
    )
