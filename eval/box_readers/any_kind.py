"""Boxes of a file whose kind is told by what it holds."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from eval.box_readers.kitti import read_kitti_frames, read_kitti_tracking
from eval.box_readers.layers import boxes_of_layers
from eval.box_readers.nuscenes import boxes_of_nuscenes
from eval.box_readers.ovmono3d import boxes_of_ovmono3d
from eval.box_readers.waymo import boxes_of_waymo
from eval.boxes import Boxes
from eval.errors import MetricError, MissingError
from eval.text_files import read_json

WAYMO = {"laser_labels", "laserLabels"}


def read_boxes(
    path: Path,
    *,
    projection: ArrayLike | None = None,
    extrinsic: ArrayLike | None = None,
    camera_to_world: Mapping[str, ArrayLike] | None = None,
    categories: Mapping[int, str] | None = None,
) -> Boxes:
    """Boxes of a folder or file (.txt) of KITTI labels, or of JSON of nuScenes', Waymo's, OVMono3D's or this project's.

    Parameters
    ----------
    path
        A folder and a .txt are KITTI's. JSON with "results" is nuScenes'; other objects are `boxes.json` of rendered
        layers; a list of frames with `laser_labels` is Waymo's, any other is OVMono3D's.
    projection
        P2, (3, 4), or K, (3, 3) [px]: KITTI's labels take it.
    extrinsic
        Camera to vehicle, (4, 4): Waymo's boxes take it.
    camera_to_world
        Poses by frame, (4, 4): `boxes.json` takes them; nuScenes' boxes are in the camera frame without them.
    categories
        Names of OVMono3D's numbers; without them the number is the name.

    Raises
    ------
    MissingError
        What these boxes take was not given.
    MetricError
        The file or an entry is not what is expected.
    """
    if path.is_dir() or path.suffix.lower() == ".txt":
        return _read_kitti(path, projection)
    content = read_json(path)
    if isinstance(content, dict) and "results" in content:
        return boxes_of_nuscenes(content, camera_to_world, path)
    if isinstance(content, dict):
        if camera_to_world is None:
            raise MissingError(f"--clip: the clip of the scene, in whose world the boxes of {path} are")
        return boxes_of_layers(content, camera_to_world, path)
    if _is_waymo(content):
        if extrinsic is None:
            raise MissingError(f"--camera: with `extrinsic`, camera to vehicle, for the Waymo boxes of {path}")
        return boxes_of_waymo(content, extrinsic, path)
    return boxes_of_ovmono3d(content, categories, path)


def _read_kitti(path: Path, projection: ArrayLike | None) -> Boxes:
    if path.is_dir() and not any(path.glob("*.txt")):
        raise MetricError(f"{path}: expected a file of boxes or a folder of KITTI labels *.txt, got a folder without")
    if projection is None:
        raise MissingError(f"--calib: the calibration file with P2, for the KITTI labels of {path}")
    return read_kitti_frames(path, projection) if path.is_dir() else read_kitti_tracking(path, projection)


def _is_waymo(content: Any) -> bool:
    """Whether it is a list of frames with Waymo's labels."""
    return isinstance(content, list) and any(isinstance(frame, dict) and frame.keys() & WAYMO for frame in content)
