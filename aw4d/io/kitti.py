"""KITTI raw drives (Geiger et al., "Vision meets robotics", IJRR 2013): left colour camera and laser scanner."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aw4d.camera import Camera
from aw4d.clip import ClipInfo
from aw4d.errors import InputError
from aw4d.io.files import fingerprint, listed, read_bytes, read_text
from aw4d.io.images import PNG, read_rgb
from aw4d.io.kitti_geometry import (
    CALIBRATION_FILES,
    IMU_FILE,
    Calibration,
    camera_poses,
    find_calibration,
    read_boxes,
    read_calibration,
)
from aw4d.io.source import LEVEL, Source, check_size, clean_points

LICENCE = (
    "KITTI Vision Benchmark Suite, CC BY-NC-SA 3.0 (non-commercial); "
    "(c) A. Geiger, P. Lenz, C. Stiller, R. Urtasun, IJRR 2013"
)
RATE_HZ = 10.0  # of the scanner, which triggers the cameras
FEWEST_RETURNS = 200  # in the picture; a real scan has about 20,000 there
BYTES_A_RETURN = 16  # float32 x, y, z, reflectance
SAMPLED_SCANS = 9  # scans projected before the work begins

STILL = "No GPS/IMU poses (oxts): the camera is taken as still, so weather anchored to the world swims when it moves."
UNCORRECTED = "LiDAR returns are not corrected for the motion of other vehicles during a turn of the scanner."


@dataclass(frozen=True, kw_only=True)
class _Drive:
    """The files of a drive, one entry a frame."""

    folder: Path
    frames: list[int]
    images: list[Path]
    scans: list[Path]
    calibration: Calibration

    def rgb(self, index: int) -> NDArray[np.uint8]:
        return check_size(
            read_rgb(self.images[index]), self.calibration.width, self.calibration.height, str(self.images[index])
        )

    def points(self, index: int) -> NDArray[np.float32]:
        path = self.scans[index]
        scan = clean_points(np.frombuffer(read_bytes(path), dtype="<f4").reshape(-1, 4).copy())
        transform = self.calibration.velodyne_to_camera
        scan[:, :3] = scan[:, :3] @ transform[:3, :3].T + transform[:3, 3]
        camera = Camera(width=self.calibration.width, height=self.calibration.height, K=self.calibration.K)
        seen = returns_in_picture(scan, camera)
        if seen < FEWEST_RETURNS:
            raise InputError(
                f"{path}: does not match the image of frame {self.frames[index]}: expected at least {FEWEST_RETURNS} "
                f"returns in the picture, got {seen} of {len(scan)}"
            )
        return scan


def returns_in_picture(points: NDArray[np.float32], camera: Camera) -> int:
    """How many camera-frame points, (n, 3 or more) [m], project into the picture."""
    u, v, _ = camera.project(points[:, :3]).T
    with np.errstate(invalid="ignore"):
        inside = (u > -0.5) & (u < camera.width - 0.5) & (v > -0.5) & (v < camera.height - 0.5)
    return int(np.count_nonzero(inside))


def _some(frames: list[int]) -> str:
    return f"{', '.join(map(str, frames[:6]))}{' …' if len(frames) > 6 else ''}"


def _numbered(folder: Path, suffixes: tuple[str, ...]) -> dict[int, Path]:
    return {int(path.stem): path for path in listed(folder, suffixes) if path.stem.isdecimal()}


def _matching(kind: str, folder: Path, suffix: str, frames: list[int], hint: str = "") -> list[Path]:
    """The file of each frame; a hint ends the error.

    Raises
    ------
    InputError
        Some frames have none.
    """
    found = _numbered(folder, (suffix,))
    missing = [frame for frame in frames if frame not in found]
    if missing:
        raise InputError(
            f"{folder}: {kind} does not match the images: expected a {suffix} file for each of {len(frames)} frames, "
            f"got none for {len(missing)} of them: {_some(missing)}{hint}"
        )
    return [found[frame] for frame in frames]


def _calibration(drive: Path) -> Calibration:
    paths = [find_calibration(drive, name) for name in CALIBRATION_FILES]
    cam_to_cam, velo_to_cam = paths
    if cam_to_cam is None or velo_to_cam is None:
        missing = [name for name, path in zip(CALIBRATION_FILES, paths, strict=True) if path is None]
        raise InputError(f"{drive}: expected {' and '.join(missing)} in the drive's parent folder or in the drive")
    return read_calibration(cam_to_cam, velo_to_cam)


def _files(folder: Path, skip_missing: bool) -> _Drive:
    images = _numbered(folder / "image_02" / "data", PNG)
    if not images:
        raise InputError(f"{folder}: expected a KITTI raw drive with pictures in image_02/data/*.png, got none")
    if not (folder / "velodyne_points" / "data").is_dir():
        raise InputError(
            f"{folder}: expected laser scans in velodyne_points/data/*.bin, got no such folder; "
            "for pictures without LiDAR see `aw4d ingest frames` and `aw4d ingest video`"
        )
    frames = sorted(images)
    if skip_missing:
        scanned = _numbered(folder / "velodyne_points" / "data", (".bin",))
        frames = [frame for frame in frames if frame in scanned]
    scans = _matching("LiDAR", folder / "velodyne_points" / "data", ".bin", frames, "; --skip-missing leaves them out")
    for path in scans:
        size = path.stat().st_size
        if size == 0 or size % BYTES_A_RETURN:
            raise InputError(f"{path}: expected {BYTES_A_RETURN} bytes a return, got {size} bytes (truncated?)")
    return _Drive(
        folder=folder,
        frames=frames,
        images=[images[frame] for frame in frames],
        scans=scans,
        calibration=_calibration(folder),
    )


def _times(path: Path, frames: list[int]) -> NDArray[np.float64]:
    """Seconds since the first frame; line n of the file belongs to frame n of the drive."""
    if not path.is_file():
        return np.asarray(np.subtract(frames, frames[0]) / RATE_HZ, dtype=np.float64)
    lines = read_text(path).split("\n")
    try:
        stamps = np.array([lines[frame].strip() for frame in frames], dtype="datetime64[ns]")
    except (IndexError, ValueError) as error:
        raise InputError(f"{path}: expected a date and time in each line up to {frames[-1] + 1} ({error})") from error
    return np.asarray((stamps - stamps[0]) / np.timedelta64(1, "s"), dtype=np.float64)


def _poses(drive: _Drive) -> tuple[NDArray[np.float64], tuple[float, float, float], list[Path]]:
    folder = drive.folder / "oxts" / "data"
    if not folder.is_dir():
        return np.tile(LEVEL, (len(drive.frames), 1, 1)), (0.0, 0.0, 0.0), []
    imu = find_calibration(drive.folder, IMU_FILE)
    if imu is None:
        raise InputError(f"{drive.folder}: has oxts but no {IMU_FILE}, in its parent folder or in itself")
    oxts = _matching("GPS/IMU", folder, ".txt", drive.frames)
    poses, origin = camera_poses(oxts, imu, drive.calibration)
    return poses, origin, oxts


def _labels(drive: Path, labels: Path | None) -> Path | None:
    if labels is not None:
        return labels
    found = sorted(drive.glob("label_02*.txt"))
    if len(found) > 1:
        raise InputError(f"{drive}: expected one label_02*.txt, got {len(found)}; choose with --labels")
    return found[0] if found else None


def open_kitti(drive: Path, *, labels: Path | None = None, skip_missing: bool = False) -> Source:
    """Open a raw drive: the frames that image_02 has.

    Parameters
    ----------
    drive
        Folder with image_02/data/*.png and velodyne_points/data/*.bin; calibration in its parent folder or in itself;
        oxts/data/*.txt and timestamps if there are any.
    labels
        3D boxes in the format of the tracking benchmark, with the drive's frame numbers; without it, a
        label_02*.txt in the drive.
    skip_missing
        Leave out frames that have no scan (some published drives lack a few); otherwise they are an error.

    Raises
    ------
    InputError
        A file is missing, truncated or corrupt, or LiDAR and images do not match; the message names it.
    """
    drive = Path(drive)
    if not drive.is_dir():
        raise InputError(f"{drive}: expected the folder of a KITTI raw drive")
    files = _files(drive, skip_missing)
    poses, origin, oxts = _poses(files)
    label_file = _labels(drive, labels)
    count, calibration = len(files.frames), files.calibration
    info = ClipInfo(
        name=drive.resolve().name,
        width=calibration.width,
        height=calibration.height,
        K=np.tile(calibration.K, (count, 1, 1)),
        camera_to_world=poses,
        times=_times(drive / "image_02" / "timestamps.txt", files.frames),
        world_origin=origin,
        provenance={
            "rgb": f"image_02, frames {files.frames[0]} to {files.frames[-1]}",
            "points": "velodyne_points, in the camera frame",
            "K": "P_rect_02",
            "camera_to_world": "oxts (Mercator), y up, about the first camera"
            if oxts
            else "none: a level, still camera",
            "boxes": label_file.name if label_file else "none",
        },
        approximations=[UNCORRECTED] if oxts else [UNCORRECTED, STILL],
        licence=LICENCE,
        boxes=read_boxes(label_file, files.frames, poses, calibration) if label_file else [],
    )
    for index in np.unique(np.linspace(0, count - 1, SAMPLED_SCANS).astype(int)):
        files.points(int(index))
    inputs = [*files.images, *files.scans, *oxts, *([label_file] if label_file else [])]
    return Source(
        info=info, rgb=files.rgb, points=files.points, fingerprint=fingerprint(inputs, "kitti", calibration.K.tolist())
    )
