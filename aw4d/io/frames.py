"""A folder of pictures with depth and other planes in folders beside them, paired by file name."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from aw4d.camera import Camera
from aw4d.clip import ClipInfo
from aw4d.errors import InputError
from aw4d.gbuffer import Plane, check_depth_unit, check_plane
from aw4d.io.files import fingerprint, listed, read_bytes
from aw4d.io.frames_geometry import read_intrinsics, read_poses, read_times
from aw4d.io.images import PICTURES, read_rgb
from aw4d.io.planes import FEWEST_DENSE, READERS, SUFFIXES, read_depth, read_npy
from aw4d.io.source import LEVEL, Source, about_first, check_size, clean_points

POINT_SUFFIXES = (".npy", ".bin")
STILL = "No poses: the camera is taken as still, so weather that is anchored to the world swims when it moves."
ASSUMED_HEIGHT = "No depth was given: it is that of a level road {:g} m under the camera, with upright things on it."


@dataclass(frozen=True, kw_only=True)
class _Folder:
    """The files by plane name, one a frame each."""

    images: list[Path]
    files: dict[str, list[Path]]
    camera: Camera
    depth_scale: float | None
    relative: bool

    def rgb(self, index: int) -> NDArray[np.uint8]:
        return check_size(read_rgb(self.images[index]), self.camera.width, self.camera.height, str(self.images[index]))

    def points(self, index: int) -> NDArray[np.float32] | None:
        if "points" in self.files:
            return _read_points(self.files["points"][index])
        depth = self._depth(index)
        if depth is None or _dense(depth):
            return None
        xyz = self.camera.unproject(depth)[depth > 0]
        return np.column_stack([xyz, np.zeros(len(xyz))]).astype(np.float32)

    def planes(self, index: int) -> dict[str, Plane]:
        planes = {name: self._plane(name, index) for name in READERS if name in self.files}
        depth = self._depth(index)
        if depth is not None and _dense(depth):
            if not self.relative:
                check_depth_unit(depth[depth > 0], None)
            planes["depth"] = _filled(depth)
        return planes

    def _plane(self, name: str, index: int) -> Plane:
        path = self.files[name][index]
        try:
            return check_plane(name, READERS[name](path), *self.camera.shape)
        except InputError as error:
            raise InputError(f"{path}: {str(error).removeprefix(f'{path}: ')}") from error

    def _depth(self, index: int) -> NDArray[np.float32] | None:
        if "depth" not in self.files:
            return None
        path = self.files["depth"][index]
        depth = read_depth(path, self.depth_scale)
        if depth.shape != self.camera.shape:
            raise InputError(f"{path}: depth: expected {self.camera.shape} as the picture, got {depth.shape}")
        if not depth.any():
            raise InputError(f"{path}: depth: expected metres, got no pixel that is positive and finite")
        return depth


def _dense(depth: NDArray[np.float32]) -> bool:
    return bool(np.count_nonzero(depth) >= FEWEST_DENSE * depth.size)


def _filled(depth: NDArray[np.float32]) -> NDArray[np.float32]:
    """The plane with its holes filled from the nearest pixel that has a depth."""
    hole = depth <= 0
    if not hole.any():
        return depth
    rows, columns = distance_transform_edt(hole, return_distances=False, return_indices=True)
    filled: NDArray[np.float32] = depth[rows, columns]
    return filled


def _read_points(path: Path) -> NDArray[np.float32]:
    if path.suffix == ".bin":
        data = read_bytes(path)
        if len(data) % 16:
            raise InputError(f"{path}: expected 16 bytes a return, got {len(data)} bytes (truncated?)")
        points = np.frombuffer(data, dtype="<f4").reshape(-1, 4)
    else:
        points = read_npy(path).astype(np.float32)
    if points.ndim != 2 or points.shape[1] not in (3, 4):
        raise InputError(f"{path}: expected points (n, 3) or (n, 4), got {points.shape}")
    return clean_points(np.column_stack([points, np.zeros((len(points), 4 - points.shape[1]))]).astype(np.float32))


def _paired(folder: Path, name: str, suffixes: tuple[str, ...], stems: list[str]) -> list[Path]:
    """The plane's files in the order of the pictures; empty where there is no such folder.

    Raises
    ------
    InputError
        The names do not match those of the pictures.
    """
    found = {path.stem: path for path in listed(folder / name, suffixes)}
    if not (folder / name).is_dir():
        return []
    missing = [stem for stem in stems if stem not in found]
    surplus = sorted(set(found) - set(stems))
    if missing or surplus:
        few = ", ".join((missing or surplus)[:6])
        what = f"no file for {len(missing)} of {len(stems)} pictures" if missing else "files without a picture"
        raise InputError(f"{folder / name}: does not match the pictures: {what}: {few}")
    return [found[stem] for stem in stems]


def _files(folder: Path, stems: list[str]) -> dict[str, list[Path]]:
    files = {name: _paired(folder, name, SUFFIXES, stems) for name in ("depth", *READERS)}
    files["points"] = _paired(folder, "points", POINT_SUFFIXES, stems)
    return {name: paths for name, paths in files.items() if paths}


def _check_depth_source(
    folder: Path, files: dict[str, list[Path]], relative_depth: bool, camera_height_m: float | None
) -> None:
    if camera_height_m is not None and not 0 < camera_height_m < 100:
        raise InputError(f"camera_height_m: expected a height above the road in metres, got {camera_height_m}")
    if "points" in files or camera_height_m is not None:
        return
    if "depth" not in files:
        raise InputError(f"{folder}: expected depth/, points/ or the height of the camera to take depth from, got none")
    if relative_depth:
        raise InputError(f"{folder}: relative depth needs points/ or the height of the camera, got neither")


def _info(
    folder: Path,
    files: dict[str, list[Path]],
    K: NDArray[np.float64],
    *,
    size: tuple[int, int],
    count: int,
    fps: float,
    camera_height_m: float | None,
) -> ClipInfo:
    poses, approximations = read_poses(folder, count), []
    if poses is None:
        poses = np.tile(LEVEL, (count, 1, 1))
        approximations.append(STILL)
    if camera_height_m is not None and not files.keys() & {"depth", "points"}:
        approximations.append(ASSUMED_HEIGHT.format(camera_height_m))
    poses, origin = about_first(poses)
    return ClipInfo(
        name=folder.resolve().name,
        width=size[0],
        height=size[1],
        K=np.tile(K, (count, 1, 1)),
        camera_to_world=poses,
        times=read_times(folder, count, fps),
        world_origin=origin,
        provenance={"rgb": "rgb/"} | {name: f"{name}/" for name in files},
        approximations=approximations,
    )


def open_frames(
    folder: Path,
    *,
    focal_px: float | None = None,
    fov_deg: float | None = None,
    fps: float = 10.0,
    depth_scale: float | None = None,
    relative_depth: bool = False,
    camera_height_m: float | None = None,
) -> Source:
    """Open a folder of pictures, rgb/, and planes in folders of the planes' names; files pair by name.

    depth/, normal/, albedo/, … hold .png, .npy or .exr; points/ holds laser returns in the camera frame, .npy or .bin;
    intrinsics.json has K; poses.json or poses.txt has camera-to-world matrices, y up; times.txt has seconds.

    Parameters
    ----------
    folder
        The folder that holds rgb/.
    focal_px, fov_deg
        Focal length [px] or horizontal field of view [degrees], where there is no intrinsics.json.
    fps
        Frames a second, where there is no times.txt.
    depth_scale
        Metres in one unit of the depth files; by default 1/256 for PNG and 1 for the others.
    relative_depth
        The depth is known up to scale and bias only: it is aligned with points/ or with the camera's height.
    camera_height_m
        Height of the camera above the road [m], for relative depth without points, or instead of depth.

    Raises
    ------
    InputError
        Files are missing, do not pair, or are damaged; the calibration is missing; there is nothing to take depth from.
    """
    folder = Path(folder)
    images = listed(folder / "rgb", PICTURES)
    if not images:
        raise InputError(f"{folder}: expected pictures in rgb/*.png or rgb/*.jpg, got none")
    files = _files(folder, [path.stem for path in images])
    _check_depth_source(folder, files, relative_depth, camera_height_m)
    height, width = read_rgb(images[0]).shape[:2]
    K = read_intrinsics(folder, width, height, focal_px, fov_deg)
    info = _info(folder, files, K, size=(width, height), count=len(images), fps=fps, camera_height_m=camera_height_m)
    reader = _Folder(
        images=images, files=files, camera=info.camera(0), depth_scale=depth_scale, relative=relative_depth
    )
    return Source(
        info=info,
        rgb=reader.rgb,
        points=reader.points,
        planes=reader.planes,
        fingerprint=fingerprint(
            [*images, *(path for paths in files.values() for path in paths)],
            *("frames", K.tolist(), depth_scale, relative_depth, camera_height_m),
        ),
        camera_height_m=camera_height_m,
        relative_depth=relative_depth,
    )
