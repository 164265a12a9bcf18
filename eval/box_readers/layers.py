"""Boxes of this project's clips, as rendered layers have them in `boxes.json`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from eval.box_readers.frames import by_frame, frame_name, inverse_pose
from eval.boxes import Array, Box3D, Boxes, cuboid
from eval.errors import MetricError
from eval.text_files import entry, read_json

KEYS = "a box with track_id, category, object_to_world (4, 4) and size (length, height, width)"


def read_layers(path: Path, camera_to_world: Mapping[str, ArrayLike]) -> Boxes:
    """Boxes of a `boxes.json`; see `boxes_of_layers`."""
    return boxes_of_layers(read_json(path), camera_to_world, path)


def boxes_of_layers(
    frames: Mapping[str, Sequence[Mapping[str, Any]]], camera_to_world: Mapping[str, ArrayLike], source: Path
) -> Boxes:
    """Boxes in their cameras' frames.

    Parameters
    ----------
    frames
        By frame, boxes with track_id, category, object_to_world, (4, 4), whose axes are x forward, y up, z right, and
        size: length, height, width [m].
    camera_to_world
        Pose of each frame's camera in the same world, (4, 4), camera axes OpenCV.
    source
        Where they come from, for errors.

    Raises
    ------
    MetricError
        A box is not what is expected, or a frame has no pose.
    """
    if not isinstance(frames, Mapping):
        raise MetricError(f"{source}: expected an object of lists of boxes by frame, got {type(frames).__name__}")
    boxes = []
    for frame, found in frames.items():
        name = frame_name(frame)
        with entry(source, f"frame {frame}", "a list of boxes"):
            to_camera = inverse_pose(camera_to_world, name)
            items = list(enumerate(found))
        for number, item in items:
            with entry(source, f"frame {frame}, box {number}", KEYS):
                boxes.append((name, _box(item, to_camera)))
    return by_frame(boxes)


def _box(item: Mapping[str, Any], to_camera: Array) -> Box3D:
    return Box3D(
        corners=cuboid(to_camera @ item["object_to_world"], item["size"]),
        category=str(item["category"]),
        track_id=str(int(item["track_id"])),
    )
