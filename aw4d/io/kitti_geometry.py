"""Calibration, GPS/IMU poses and 3D boxes of KITTI recordings (Geiger et al., IJRR 2013)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aw4d.boxes import Box
from aw4d.camera import Camera
from aw4d.errors import InputError
from aw4d.io.files import read_text
from aw4d.io.source import Y_UP_FROM_Z_UP, about_first

Array = NDArray[np.float64]

EARTH_RADIUS_M = 6378137.0  # of the Mercator projection in the recording's development kit
CALIBRATION_FILES = ("calib_cam_to_cam.txt", "calib_velo_to_cam.txt")
IMU_FILE = "calib_imu_to_velo.txt"


@dataclass(frozen=True, kw_only=True, eq=False)
class Calibration:
    """Geometry of the left colour camera (number 2).

    Parameters
    ----------
    K
        Intrinsics after rectification, (3, 3) [px].
    width, height
        Size that K is for [px].
    reference_to_camera
        From the rectified camera 0, in which boxes are given, 4x4.
    velodyne_to_camera
        From the laser scanner, 4x4.
    """

    K: Array
    width: int
    height: int
    reference_to_camera: Array
    velodyne_to_camera: Array


def _read_keys(path: Path) -> dict[str, str]:
    lines = (line.partition(":") for line in read_text(path).splitlines())
    return {key.strip(): value for key, colon, value in lines if colon}


def _matrix(path: Path, values: dict[str, str], key: str, shape: tuple[int, ...]) -> Array:
    if key not in values:
        raise InputError(f"{path}: expected the key {key}, got {', '.join(values) or 'none'}")
    count = int(np.prod(shape))
    try:
        numbers = np.array(values[key].split(), dtype=np.float64)
    except ValueError:
        numbers = np.empty(0)
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise InputError(f"{path}: {key}: expected {count} finite numbers, got {values[key].strip()[:60]!r}")
    return numbers.reshape(shape)


def _rigid(path: Path, rotation: Array, translation: Array | None = None) -> Array:
    if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3) or np.linalg.det(rotation) < 0:
        raise InputError(f"{path}: expected a rotation, got {rotation.tolist()}")
    left, _, right = np.linalg.svd(rotation)  # seven digits are not quite a rotation
    pose = np.eye(4)
    pose[:3, :3] = left @ right
    if translation is not None:
        pose[:3, 3] = translation
    return pose


def _read_rigid(path: Path) -> Array:
    values = _read_keys(path)
    return _rigid(path, _matrix(path, values, "R", (3, 3)), _matrix(path, values, "T", (3,)))


def find_calibration(drive: Path, name: str) -> Path | None:
    """Calibration file in the drive's parent folder, where KITTI puts it, or in the drive itself."""
    return next((folder / name for folder in (drive.resolve().parent, drive) if (folder / name).is_file()), None)


def read_calibration(cam_to_cam: Path, velo_to_cam: Path) -> Calibration:
    """Read both calibration files.

    Raises
    ------
    InputError
        A key is missing, is not of its size, or is no rotation; the message names the file and the key.
    """
    values = _read_keys(cam_to_cam)
    P = _matrix(cam_to_cam, values, "P_rect_02", (3, 4))
    width, height = _matrix(cam_to_cam, values, "S_rect_02", (2,))
    rectify = _rigid(cam_to_cam, _matrix(cam_to_cam, values, "R_rect_00", (3, 3)))
    K = P[:, :3]
    Camera(width=int(width), height=int(height), K=K)  # refuses what is no camera
    reference_to_camera = np.eye(4)
    reference_to_camera[:3, 3] = np.linalg.solve(K, P[:, 3])  # P = K [I | t]
    return Calibration(
        K=K,
        width=int(width),
        height=int(height),
        reference_to_camera=reference_to_camera,
        velodyne_to_camera=reference_to_camera @ rectify @ _read_rigid(velo_to_cam),
    )


def _rotation(roll: float, pitch: float, yaw: float) -> Array:
    """Rz(yaw) Ry(pitch) Rx(roll)."""
    (sx, sy, sz), (cx, cy, cz) = np.sin([roll, pitch, yaw]), np.cos([roll, pitch, yaw])
    Rx = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    Ry = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    Rz = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return np.asarray(Rz @ Ry @ Rx, dtype=np.float64)


def _imu_to_world(latitude: float, longitude: float, altitude: float, rotation: Array, scale: float) -> Array:
    """Mercator projection of the development kit, east, north and up."""
    pose = np.eye(4)
    pose[:3, :3] = rotation
    pose[0, 3] = scale * EARTH_RADIUS_M * np.deg2rad(longitude)
    pose[1, 3] = scale * EARTH_RADIUS_M * np.log(np.tan(np.deg2rad(90 + latitude) / 2))
    pose[2, 3] = altitude
    return pose


def _read_oxts(path: Path) -> Array:
    try:
        values = np.array(read_text(path).split()[:6], dtype=np.float64)
    except ValueError:
        values = np.empty(0)
    if len(values) != 6 or not np.isfinite(values).all() or abs(values[0]) > 85:
        raise InputError(f"{path}: expected latitude, longitude, altitude, roll, pitch and yaw, got {values.tolist()}")
    return values


def camera_poses(
    oxts: Sequence[Path], imu_to_velo: Path, calibration: Calibration
) -> tuple[Array, tuple[float, float, float]]:
    """Camera-to-world poses of the frames, y up, about the first camera's position.

    Parameters
    ----------
    oxts
        GPS/IMU file of each frame.
    imu_to_velo
        Calibration file.
    calibration
        Geometry of the camera.

    Returns
    -------
    Poses, (N, 4, 4), and the position that was subtracted [m].

    Raises
    ------
    InputError
        A file cannot be read or does not hold what is expected.
    """
    camera_to_imu = np.linalg.inv(calibration.velodyne_to_camera @ _read_rigid(imu_to_velo))
    records = [_read_oxts(path) for path in oxts]
    scale = float(np.cos(np.deg2rad(records[0][0])))
    poses = np.stack(
        [
            Y_UP_FROM_Z_UP @ _imu_to_world(lat, lon, alt, _rotation(roll, pitch, yaw), scale) @ camera_to_imu
            for lat, lon, alt, roll, pitch, yaw in records
        ]
    )
    return about_first(poses)


def _box(fields: list[str], reference_to_world: Array) -> Box:
    height, width, length, x, y, z, yaw = (float(value) for value in fields[10:17])
    # At yaw 0 the object faces along the camera's x; (x, y, z) is the middle of its bottom, and y points down.
    pose = np.eye(4)
    pose[:3, 0] = (np.cos(yaw), 0, -np.sin(yaw))
    pose[:3, 1] = (0, -1, 0)
    pose[:3, 2] = (-np.sin(yaw), 0, -np.cos(yaw))
    pose[:3, 3] = (x, y - height / 2, z)
    return Box(
        track_id=int(fields[1]),
        category=fields[2],
        object_to_world=reference_to_world @ pose,
        size=(length, height, width),
    )


def read_boxes(path: Path, frames: Sequence[int], poses: Array, calibration: Calibration) -> list[list[Box]]:
    """Boxes of each frame from labels in the format of the KITTI tracking benchmark; "DontCare" regions have none.

    Parameters
    ----------
    path
        Label file.
    frames
        Number of each frame in the drive.
    poses
        Camera-to-world, (N, 4, 4).
    calibration
        Geometry of the camera.

    Raises
    ------
    InputError
        The file cannot be read, or a line has not the 17 fields or is not numeric where it must be.
    """
    place = {frame: index for index, frame in enumerate(frames)}
    boxes: list[list[Box]] = [[] for _ in frames]
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        fields = line.split()
        try:
            if len(fields) < 17:
                raise ValueError("expected 17 fields")
            index = place.get(int(fields[0]))
            if index is not None and fields[2] != "DontCare":
                boxes[index].append(_box(fields, poses[index] @ calibration.reference_to_camera))
        except ValueError as error:
            raise InputError(f"{path}: line {number}: {error}") from error
    return boxes
