"""Waymo-style JSON (Sun et al. 2020): frames of the Waymo Open Dataset's protocol buffers printed as JSON."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from eval.box_readers.frames import by_frame, frame_name, inverse
from eval.boxes import Array, Box3D, Boxes, cuboid
from eval.errors import MetricError
from eval.text_files import entry, read_json

TYPES = {1: "TYPE_VEHICLE", 2: "TYPE_PEDESTRIAN", 3: "TYPE_SIGN", 4: "TYPE_CYCLIST"}
KEYS = "a label with box (center_x, center_y, center_z, length, width, height, heading), type and id"

# Waymo's cameras look along x, with y to the left and z up.
_OPENCV_FROM_WAYMO = np.array([[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]], dtype=np.float64)


def read_waymo(path: Path, extrinsic: ArrayLike) -> Boxes:
    """Boxes of a list of frames, each with `laser_labels` and either `frame` or `timestamp_micros`, its name.

    Of a label are read: `box` with center_x, center_y, center_z, length, width, height [m] and heading [rad, from x to
    y] in the vehicle's frame (x forward, y left, z up); `type`, by name or number; and `id`, if there. Keys may be in
    camelCase as `MessageToJson` prints them, which leaves out zeros: an absent coordinate or heading is 0.

    Parameters
    ----------
    path
        File of frames.
    extrinsic
        The camera's `extrinsic.transform`, (4, 4), camera to vehicle, for Waymo's camera axes: x forward, y left, z up.

    Raises
    ------
    MetricError
        The file or an entry is not what is expected.
    """
    return boxes_of_waymo(read_json(path), extrinsic, path)


def boxes_of_waymo(frames: Any, extrinsic: ArrayLike, source: Path) -> Boxes:
    """Boxes of what a file of frames holds; see `read_waymo`. `source` is named in errors."""
    to_camera = _OPENCV_FROM_WAYMO @ inverse(extrinsic)
    frames = _snake(frames)
    if not isinstance(frames, list):
        raise MetricError(f"{source}: expected a list of frames, got {type(frames).__name__}")
    boxes = []
    for number, frame in enumerate(frames):
        with entry(source, f"frame {number}", "an object with frame or timestamp_micros, and laser_labels"):
            name = frame_name(frame["frame"] if "frame" in frame else frame["timestamp_micros"])
            labels = list(enumerate(frame["laser_labels"]))
        for place, label in labels:
            with entry(source, f"frame {number}, label {place}", KEYS):
                boxes.append((name, _box(label, to_camera)))
    return by_frame(boxes)


def _box(label: Mapping[str, Any], to_camera: Array) -> Box3D:
    box = label["box"]
    heading = float(box.get("heading", 0))
    pose = np.eye(4)
    pose[:2, :2] = [[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]]
    pose[:3, 3] = [float(box.get(name, 0)) for name in ("center_x", "center_y", "center_z")]
    category = TYPES.get(label["type"], label["type"])
    if not isinstance(category, str):
        raise MetricError(f"type: expected a name or one of {sorted(TYPES)}, got {category}")
    return Box3D(
        corners=cuboid(to_camera @ pose, [float(box[name]) for name in ("length", "width", "height")]),
        category=category,
        track_id=str(label["id"]) if "id" in label else None,
    )


def _snake(value: Any) -> Any:
    """The same with every key in snake_case."""
    if isinstance(value, dict):
        return {re.sub("([A-Z])", r"_\1", key).lower(): _snake(item) for key, item in value.items()}
    return [_snake(item) for item in value] if isinstance(value, list) else value
