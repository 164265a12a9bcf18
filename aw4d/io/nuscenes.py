"""nuScenes keyframes (Caesar et al., CVPR 2020) by the info files that 3D detection tools make: front camera, LiDAR."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aw4d.boxes import Box
from aw4d.clip import ClipInfo
from aw4d.errors import InputError
from aw4d.io.files import fingerprint, listed, read_bytes
from aw4d.io.images import read_rgb
from aw4d.io.safe_pickle import read_plain_pickle
from aw4d.io.source import Y_UP_FROM_Z_UP, Source, about_first, check_size, clean_points

Array = NDArray[np.float64]

LICENCE = "nuScenes, CC BY-NC-SA 4.0 (non-commercial); (c) Motional, Caesar et al., CVPR 2020"
CAMERA, LIDAR = "CAM_FRONT", "LIDAR_TOP"
UNTRACKED = "Boxes have no identity from keyframe to keyframe: each is an object of its own."
KEYFRAMES = "Keyframes at 2 Hz: motion between them is not recorded."


@dataclass(frozen=True, kw_only=True, eq=False)
class _Keyframe:
    """One sample of an info file; matrices 4x4."""

    image: Path
    scan: Path
    features: int
    time: float
    K: Array
    lidar_to_camera: Array
    lidar_to_world: Array
    instances: list[dict[str, Any]]

    @property
    def camera_to_world(self) -> Array:
        # By way of the scan, since lidar_to_camera holds how far the car drove between scan and exposure.
        return self.lidar_to_world @ np.linalg.inv(self.lidar_to_camera)

    def points(self) -> NDArray[np.float32]:
        data = read_bytes(self.scan)
        if len(data) % (4 * self.features):
            raise InputError(f"{self.scan}: expected {4 * self.features} bytes a return, got {len(data)} (truncated?)")
        scan = np.frombuffer(data, dtype="<f4").reshape(-1, self.features)[:, :4].copy()
        scan[:, 3] /= 255  # intensity is stored as 0 to 255
        scan = clean_points(scan)
        scan[:, :3] = scan[:, :3] @ self.lidar_to_camera[:3, :3].T + self.lidar_to_camera[:3, 3]
        return scan


def _matrix(value: Any, size: int) -> Array:
    matrix = np.asarray(value, dtype=np.float64)
    if matrix.shape != (size, size) or not np.isfinite(matrix).all():
        raise ValueError(f"expected a finite {size}x{size} matrix, got shape {matrix.shape}")
    return matrix


def _rigid(value: Any) -> Array:
    pose = _matrix(value, 4).copy()
    left, _, right = np.linalg.svd(pose[:3, :3])  # stored in single precision
    if not np.allclose(left @ right, pose[:3, :3], atol=1e-3):
        raise ValueError(f"expected a rigid transform, got {pose.tolist()}")
    pose[:3, :3] = left @ right
    return pose


def _file(folder: Path, sensor: str, name: str) -> Path:
    for path in (folder / name, folder / "samples" / sensor / name):
        if path.is_file():
            return path
    raise InputError(f"{folder}: expected {name} in it or in samples/{sensor}, got no such file")


def _features(value: Any) -> int:
    """Numbers a return: x, y, z, intensity and more."""
    features = int(value)
    if features < 4:
        raise ValueError(f"num_pts_feats: expected 4 or more, got {value}")
    return features


def _keyframe(folder: Path, sample: dict[str, Any]) -> _Keyframe:
    camera, lidar = sample["images"][CAMERA], sample["lidar_points"]
    return _Keyframe(
        image=_file(folder, CAMERA, Path(camera["img_path"]).name),
        scan=_file(folder, LIDAR, Path(lidar["lidar_path"]).name),
        features=_features(lidar["num_pts_feats"]),
        time=float(camera["timestamp"]),
        K=_matrix(camera["cam2img"], 3),
        lidar_to_camera=_rigid(camera["lidar2cam"]),
        lidar_to_world=Y_UP_FROM_Z_UP @ _rigid(sample["ego2global"]) @ _rigid(lidar["lidar2ego"]),
        instances=list(sample.get("instances", [])),
    )


def _keyframes(folder: Path, path: Path) -> tuple[list[_Keyframe], dict[int, str]]:
    info = read_plain_pickle(path)
    try:
        names = {int(number): str(name) for name, number in info["metainfo"]["categories"].items()}
        return [_keyframe(folder, sample) for sample in info["data_list"]], names
    except InputError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError, np.linalg.LinAlgError) as error:
        raise InputError(
            f"{path}: expected a nuScenes info file with data_list, images, lidar_points and categories ({error!r})"
        ) from error


def _all_keyframes(folder: Path, infos: list[Path]) -> tuple[list[_Keyframe], dict[int, str]]:
    """Keyframes of all info files in order of time, and the names of the categories."""
    if not infos:
        raise InputError(f"{folder}: expected nuScenes info files (*.pkl), got none")
    keyframes: list[_Keyframe] = []
    names: dict[int, str] = {}
    for path in infos:
        found, categories = _keyframes(folder, path)
        keyframes += found
        names |= categories
    if not keyframes:
        raise InputError(f"{folder}: expected at least one keyframe in {infos[0].name}, got none")
    return sorted(keyframes, key=lambda keyframe: keyframe.time), names


def _box(instance: dict[str, Any], track_id: int, names: dict[int, str], lidar_to_world: Array) -> Box:
    x, y, z, length, width, height, yaw = (float(value) for value in instance["bbox_3d"][:7])
    # The scanner's z is up; (x, y, z) is the box's centre, and yaw turns from its x to its y.
    pose = np.eye(4)
    pose[:3, 0] = (np.cos(yaw), np.sin(yaw), 0)
    pose[:3, 1] = (0, 0, 1)
    pose[:3, 2] = (np.sin(yaw), -np.cos(yaw), 0)
    pose[:3, 3] = (x, y, z)
    category = names.get(int(instance["bbox_label_3d"]), "unknown")
    return Box(
        track_id=track_id, category=category, object_to_world=lidar_to_world @ pose, size=(length, height, width)
    )


def _boxes(keyframes: list[_Keyframe], names: dict[int, str], origin: Array) -> list[list[Box]]:
    """Boxes that the annotators' tools call valid, numbered through all keyframes."""
    boxes: list[list[Box]] = []
    number = 0
    for keyframe in keyframes:
        lidar_to_world = keyframe.lidar_to_world.copy()
        lidar_to_world[:3, 3] -= origin
        valid = [instance for instance in keyframe.instances if instance.get("bbox_3d_isvalid", True)]
        boxes.append([_box(instance, number + i, names, lidar_to_world) for i, instance in enumerate(valid)])
        number += len(valid)
    return boxes


def open_nuscenes(folder: Path) -> Source:
    """Open keyframes of the front camera.

    Parameters
    ----------
    folder
        Info files (*.pkl) of one scene, each of one keyframe or more, with the pictures and scans that they name, in
        the folder itself or under samples/CAM_FRONT and samples/LIDAR_TOP.

    Raises
    ------
    InputError
        A file is missing, truncated or not what is expected, or an info file holds more than plain data.
    """
    folder = Path(folder)
    infos = listed(folder, (".pkl",))
    keyframes, names = _all_keyframes(folder, infos)
    height, width = read_rgb(keyframes[0].image).shape[:2]
    poses, origin = about_first(np.stack([keyframe.camera_to_world for keyframe in keyframes]))
    try:
        boxes = _boxes(keyframes, names, np.array(origin))
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise InputError(f"{folder}: expected boxes of 7 numbers with a label ({error})") from error
    info = ClipInfo(
        name=infos[0].stem,
        width=width,
        height=height,
        K=np.stack([keyframe.K for keyframe in keyframes]),
        camera_to_world=poses,
        times=np.array([keyframe.time - keyframes[0].time for keyframe in keyframes]),
        world_origin=origin,
        provenance={
            "rgb": CAMERA,
            "points": f"{LIDAR}, in the camera frame at its exposure",
            "K": "cam2img",
            "camera_to_world": "ego2global, lidar2ego and lidar2cam, y up, about the first camera",
            "boxes": f"annotations in {', '.join(path.name for path in infos)}",
        },
        approximations=[UNTRACKED, KEYFRAMES] if len(keyframes) > 1 else [UNTRACKED],
        licence=LICENCE,
        boxes=boxes,
    )
    files = [*infos, *(file for keyframe in keyframes for file in (keyframe.image, keyframe.scan))]
    return Source(
        info=info,
        rgb=lambda index: check_size(read_rgb(keyframes[index].image), width, height, str(keyframes[index].image)),
        points=lambda index: keyframes[index].points(),
        fingerprint=fingerprint(files, "nuscenes"),
    )
