"""KITTI labels (Geiger et al. 2012): a tracking file of a sequence, or a folder of label_2 files, one a frame."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from eval.box_readers.frames import by_frame, frame_name
from eval.boxes import Array, Box3D, Boxes, cuboid
from eval.errors import MetricError
from eval.text_files import entry, read_text

NO_BOX = "DontCare"  # regions of the picture, without a box
OBJECT_FIELDS = 15  # type, truncated, occluded, alpha, 4 of the 2D box, 3 of the size, 3 of the place, rotation_y
PROJECTIONS = ("P2", "P_rect_02")  # in the benchmarks' and in the raw recordings' calibration files


def read_kitti_tracking(path: Path, projection: ArrayLike) -> Boxes:
    """Boxes of a tracking label file: frame, track id, then the fields of label_2; a frame's name is its number.

    Parameters
    ----------
    path
        Label file.
    projection
        P2, (3, 4) [px], of labels in the rectified frame of camera 0, as KITTI's are; or K, (3, 3), of boxes that are
        in the camera's own frame.

    Raises
    ------
    MetricError
        The file or a line is not what is expected.
    """
    offset = _offset(projection)
    boxes = []
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        fields = line.split()
        with entry(path, f"line {number}", f"frame, track id and {OBJECT_FIELDS} fields, with a score or without"):
            frame, track_id, *rest = fields
            if rest[0] != NO_BOX:
                boxes.append((frame_name(int(frame)), _box(rest, offset, track_id=str(int(track_id)))))
    return by_frame(boxes)


def read_kitti_frames(folder: Path, projection: ArrayLike) -> Boxes:
    """Boxes of a folder of label_2 files (*.txt); a frame's name is the file's, without leading zeros.

    Parameters
    ----------
    folder
        Folder of label files.
    projection
        As in `read_kitti_tracking`, of all frames.

    Raises
    ------
    MetricError
        There are no files, or a file or a line is not what is expected.
    """
    offset = _offset(projection)
    paths = sorted(folder.glob("*.txt"))
    if not paths:
        raise MetricError(f"{folder}: expected a folder of label files *.txt, got none")
    boxes = []
    for path in paths:
        for number, line in enumerate(read_text(path).splitlines(), start=1):
            fields = line.split()
            with entry(path, f"line {number}", f"{OBJECT_FIELDS} fields, with a score or without"):
                if fields[0] != NO_BOX:
                    boxes.append((frame_name(path.stem), _box(fields, offset)))
    return by_frame(boxes)


def read_projection(path: Path) -> Array:
    """P2, (3, 4) [px], of a calibration file; its first three columns are K.

    Raises
    ------
    MetricError
        The file has no line "P2:" or "P_rect_02:" with twelve numbers.
    """
    lines = [line.partition(":") for line in read_text(path).splitlines()]
    found = [values.split() for name, _, values in lines if name.strip() in PROJECTIONS]
    if len(found) != 1:
        raise MetricError(f"{path}: expected one line P2: or P_rect_02:, got {len(found)}")
    with entry(path, "P2", "12 numbers"):
        return np.array(found[0], dtype=np.float64).reshape(3, 4)


def _offset(projection: ArrayLike) -> Array:
    """Where the labels' origin is in the camera's frame [m], (3,): P2 = K [I | offset]."""
    matrix = np.asarray(projection, dtype=np.float64)
    if matrix.shape == (3, 3):
        matrix = np.column_stack([matrix, np.zeros(3)])
    if matrix.shape != (3, 4) or not np.isfinite(matrix).all() or np.linalg.det(matrix[:, :3]) == 0:
        raise MetricError(f"projection: expected P2, (3, 4), or K, (3, 3), finite, got {matrix.tolist()}")
    return np.asarray(np.linalg.solve(matrix[:, :3], matrix[:, 3]), dtype=np.float64)


def _box(fields: Sequence[str], offset: Array, track_id: str | None = None) -> Box3D:
    if len(fields) not in (OBJECT_FIELDS, OBJECT_FIELDS + 1):
        raise MetricError(f"expected {OBJECT_FIELDS} fields of an object, and a score or none, got {len(fields)}")
    height, width, length, x, y, z, rotation_y = (float(field) for field in fields[8:15])
    # At 0 the object faces along the camera's x, and rotation_y turns it about y, which points down; (x, y, z) is the
    # middle of its bottom.
    cos, sin = np.cos(rotation_y), np.sin(rotation_y)
    pose = np.eye(4)
    pose[:3, :3] = [[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]]
    pose[:3, 3] = np.add((x, y - height / 2, z), offset)
    return Box3D(
        corners=cuboid(pose, (length, height, width)),
        category=fields[0],
        track_id=track_id,
        score=float(fields[OBJECT_FIELDS]) if len(fields) > OBJECT_FIELDS else None,
    )
