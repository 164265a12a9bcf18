"""Box IoU: whose boxes, seen by which cameras."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aw4d.clip import Clip
from aw4d.errors import InputError
from aw4d.evaluation.pairs import Selection
from aw4d.evaluation.request import Found, MissingInputError, Request, Watch
from aw4d.evaluation.videos import is_clip
from aw4d.io.files import read_text
from eval import box_readers
from eval.box_iou import BoxIoU, box_iou
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
    formats
        What files of some kinds take besides, by `eval.box_readers.read_boxes`' names.
    first_frame
        Number that files give to the first frame.
    """

    cameras: Mapping[str, Camera]
    camera_to_world: Mapping[str, Array]
    camera: Camera | None = None
    formats: Mapping[str, Any]
    first_frame: int = 0

    def of(self, *sides: Boxes) -> Mapping[str, Camera]:
        """Camera of every frame: those of the clip, else of the frames that have a box."""
        if self.camera is None:
            return self.cameras
        names = {frame for side in sides for frame in side}
        return dict.fromkeys(sorted(names, key=lambda name: (len(name), name)), self.camera)


def boxes(request: Request, conventions: Mapping[str, Any], watch: Watch) -> dict[str, Found]:
    """IoU of the boxes of two files, frames paired by name."""
    convention: BoxIoU = conventions["iou"]
    if request.min_score is not None:
        convention = replace(convention, min_score=request.min_score)
    ref, gen = request.both("boxes", "3D boxes, JSON, labels of KITTI's or a clip")
    view = _view(request, ref)
    sides = [read_boxes(path, view) for path in (ref, gen)]
    cameras = view.of(*sides)
    chosen = _chosen(cameras, request.selection)
    left = [{name: found for name, found in side.items() if name in chosen or name not in cameras} for side in sides]
    ours, theirs = left
    score = box_iou(ours, theirs, {name: cameras[name] for name in chosen}, convention)
    numbers = [int(name) for name in chosen] if all(name.isdigit() for name in chosen) else []
    return {"iou": Found(scores={gen.stem: score}, numbers={gen.stem: numbers})}


def _chosen(cameras: Mapping[str, Camera], selection: Selection) -> list[str]:
    """Frames that the selection takes; of boxes both sides have the same numbers, so a stride is one number."""
    names = list(cameras)
    return [names[index] for index in selection.range_of(len(names), side="ref")]


def _view(request: Request, ref: Path) -> View:
    formats: dict[str, Any] = {}
    if request.calib is not None:
        formats["projection"] = box_readers.read_projection(request.calib)
    if request.categories is not None:
        formats["categories"] = box_readers.read_category_names(request.categories)
    if request.camera is not None:
        camera, extrinsic = _read_camera(request.camera)
        formats["extrinsic"] = extrinsic
        return View(cameras={}, camera_to_world={}, camera=camera, formats=formats, first_frame=request.first_frame)
    try:
        info = (Clip(ref) if is_clip(ref) else request.scene()).info
    except MissingInputError:
        raise MissingInputError("--clip or --camera: what the boxes are seen by") from None
    cameras = {str(i): Camera(K=info.K[i], width=info.width, height=info.height) for i in range(len(info))}
    poses = {str(i): pose for i, pose in enumerate(info.camera_to_world)}
    return View(cameras=cameras, camera_to_world=poses, formats=formats, first_frame=request.first_frame)


def _read_camera(path: Path) -> tuple[Camera, Array | None]:
    text = read_text(path)
    try:
        data = json.loads(text)
        K = data["K"] if "K" in data else [[data["fx"], 0, data["cx"]], [0, data["fy"], data["cy"]], [0, 0, 1]]
        extrinsic = np.asarray(data["extrinsic"], dtype=np.float64) if "extrinsic" in data else None
        return Camera(K=np.asarray(K, float), width=int(data["width"]), height=int(data["height"])), extrinsic
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: expected K (or fx, fy, cx, cy), width and height ({error})") from error


def read_boxes(path: Path, view: View) -> Boxes:
    """Boxes of a clip, or of a file of any known kind, by the clip's numbers of frames.

    Raises
    ------
    MetricError
        The file is of no known kind, or something that its kind takes was not given.
    """
    if is_clip(path):
        frames = {str(i): [box.to_json() for box in found] for i, found in enumerate(Clip(path).info.boxes)}
        return box_readers.boxes_of_layers(frames, view.camera_to_world, path)
    first = view.first_frame
    poses = {str(int(name) + first): pose for name, pose in view.camera_to_world.items()} or None
    found = box_readers.read_boxes(path, camera_to_world=poses, **view.formats)
    return {str(int(name) - first) if name.isdigit() else name: boxes for name, boxes in found.items()}
