"""Box IoU: whose boxes, in which format, seen by which cameras."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aw4d.clip import Clip
from aw4d.errors import InputError
from aw4d.evaluation.request import Found, MissingInputError, Request, Watch
from aw4d.evaluation.videos import is_clip
from aw4d.io.files import listed, read_text
from eval import box_readers
from eval.box_iou import box_iou
from eval.boxes import Boxes, Camera

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class View:
    """What sees the boxes: a clip's cameras and poses by frame, or one camera for all frames without poses.

    Parameters
    ----------
    cameras, camera_to_world
        By the frame's name; empty without a clip.
    camera
        That of all frames, without a clip.
    extrinsic
        Camera to vehicle, for boxes of Waymo's; None where it was not given.
    projection
        P2, for labels of KITTI's; None where it was not given.
    categories
        Names of a detector's numbers of categories; None where they were not given.
    """

    cameras: Mapping[str, Camera]
    camera_to_world: Mapping[str, Array]
    camera: Camera | None = None
    extrinsic: Array | None = None
    projection: Array | None = None
    categories: Mapping[int, str] | None = None

    def of(self, *sides: Boxes) -> Mapping[str, Camera]:
        """Camera of every frame to compare: those of the clip, else those that have a box."""
        if self.camera is None:
            return self.cameras
        names = {frame for side in sides for frame in side}
        return dict.fromkeys(sorted(names, key=lambda name: (len(name), name)), self.camera)


def boxes(request: Request, conventions: Mapping[str, Any], watch: Watch) -> dict[str, Found]:
    """IoU of the boxes of two files, frames paired by name."""
    ref, gen = request.both("boxes", "3D boxes")
    view = _view(request, ref)
    ours, theirs = (read_boxes(path, view) for path in (ref, gen))
    return {"iou": Found(scores={gen.stem: box_iou(ours, theirs, view.of(ours, theirs), conventions["iou"])})}


def _view(request: Request, ref: Path) -> View:
    formats: dict[str, Any] = {
        "projection": None if request.calib is None else box_readers.read_projection(request.calib),
        "categories": None if request.categories is None else box_readers.read_category_names(request.categories),
    }
    if request.camera is not None:
        camera, extrinsic = _read_camera(request.camera)
        return View(cameras={}, camera_to_world={}, camera=camera, extrinsic=extrinsic, **formats)
    try:
        info = (Clip(ref) if is_clip(ref) else request.scene()).info
    except MissingInputError:
        raise MissingInputError("--clip or --camera: what the boxes are seen by") from None
    cameras = {str(i): Camera(K=info.K[i], width=info.width, height=info.height) for i in range(len(info))}
    poses = {str(i): pose for i, pose in enumerate(info.camera_to_world)}
    return View(cameras=cameras, camera_to_world=poses, **formats)


def _read_camera(path: Path) -> tuple[Camera, Array | None]:
    try:
        data = json.loads(read_text(path))
        K = data["K"] if "K" in data else [[data["fx"], 0, data["cx"]], [0, data["fy"], data["cy"]], [0, 0, 1]]
        extrinsic = np.asarray(data["extrinsic"], dtype=np.float64) if "extrinsic" in data else None
        return Camera(K=np.asarray(K, float), width=int(data["width"]), height=int(data["height"])), extrinsic
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: expected K (or fx, fy, cx, cy), width and height ({error})") from error


def read_boxes(path: Path, view: View) -> Boxes:
    """Boxes of a clip, a folder of KITTI labels, a KITTI tracking file, or JSON of one of the known kinds.

    Raises
    ------
    InputError
        The file is of no known kind.
    MissingInputError
        What turns its boxes into the camera's frame was not given.
    """
    if is_clip(path):
        frames = {str(i): [box.to_json() for box in found] for i, found in enumerate(Clip(path).info.boxes)}
        return box_readers.boxes_of_layers(frames, view.camera_to_world, path)
    if path.is_dir() or path.suffix.lower() == ".txt":
        return _read_kitti(path, view)
    return _read_json(path, view)


def _read_kitti(path: Path, view: View) -> Boxes:
    if path.is_dir() and not listed(path, (".txt",)):
        raise InputError(f"{path}: expected a clip or a folder of KITTI labels (.txt), got neither")
    if view.projection is None:
        raise MissingInputError("--calib: the calibration file with P2, of labels of KITTI's")
    read = box_readers.read_kitti_frames if path.is_dir() else box_readers.read_kitti_tracking
    return read(path, view.projection)


def _read_json(path: Path, view: View) -> Boxes:
    try:
        content = json.loads(read_text(path))
    except ValueError as error:
        raise InputError(f"{path}: expected boxes as JSON ({error})") from error
    if isinstance(content, dict) and "results" in content:
        return box_readers.read_nuscenes(path, view.camera_to_world or None)
    if isinstance(content, dict):
        if not view.camera_to_world:
            raise MissingInputError("--clip: the clip of the scene, in whose world the boxes are")
        return box_readers.read_layers(path, view.camera_to_world)
    first = content[0] if isinstance(content, list) and content else None
    if isinstance(first, dict) and first.keys() & {"laser_labels", "laserLabels"}:
        if view.extrinsic is None:
            raise MissingInputError("--camera: with `extrinsic`, camera to vehicle, for boxes of Waymo's")
        return box_readers.read_waymo(path, view.extrinsic)
    return box_readers.read_ovmono3d(path, view.categories)
