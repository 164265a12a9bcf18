"""Lamps at poles in laser returns: found where a tall thin pole stands alone by the road, and nowhere else."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from aw4d.clip import Clip, ClipInfo, ClipWriter
from aw4d.gbuffer import GBuffer
from aw4d.io.source import LEVEL
from aw4d.lights.poles import pole_lamps
from aw4d.params import StreetLampParams

Array = NDArray[np.float64]
EYE = 1.73  # [m] of the scanner above the road
STEP = 1.5  # [m] a frame, along world -z
FRAMES = 24
PARAMS = StreetLampParams(every=1)

# Upright cylinders: x, z, radius, from, to [m]; the road is y = 0.
Cylinder = tuple[float, float, float, float, float]
POLE: Cylinder = (5.0, -75.0, 0.08, 0.0, 8.0)


def _scan_rays() -> Array:
    """64 rows from -24.8 to +2 degrees, camera frame with y down."""
    azimuth, elevation = np.meshgrid(np.deg2rad(np.arange(-40, 40, 0.17)), np.deg2rad(np.linspace(-24.8, 2, 64)))
    level = np.cos(elevation)
    return np.stack([level * np.sin(azimuth), -np.sin(elevation), level * np.cos(azimuth)], -1).reshape(-1, 3)


RAYS = _scan_rays()


def _hits(eye: Array, cylinders: list[Cylinder]) -> Array:
    """Distance along every ray to the road or the nearest cylinder, infinite for none."""
    ray = RAYS @ LEVEL[:3, :3].T
    with np.errstate(divide="ignore", invalid="ignore"):
        nearest = np.where(ray[:, 1] < 0, -eye[1] / ray[:, 1], np.inf)
        for x, z, radius, low, high in cylinders:
            p = eye[[0, 2]] - (x, z)
            a, b = (ray[:, [0, 2]] ** 2).sum(1), ray[:, [0, 2]] @ p
            root = np.sqrt(b**2 - a * (p @ p - radius**2))
            distance = (-b - root) / a
            height = eye[1] + distance * ray[:, 1]
            met = (distance > 0) & (height > low) & (height < high)
            nearest = np.where(met, np.minimum(nearest, distance), nearest)
    return nearest


def _clip(path: Path, cylinders: list[Cylinder]) -> Clip:
    poses = np.tile(LEVEL, (FRAMES, 1, 1))
    poses[:, 1, 3], poses[:, 2, 3] = EYE, -STEP * np.arange(FRAMES)
    K = np.tile(np.array([[8.0, 0, 7.5], [0, 8, 3.5], [0, 0, 1]]), (FRAMES, 1, 1))
    info = ClipInfo(name="scan", width=16, height=8, K=K, camera_to_world=poses, times=np.arange(FRAMES) / 10)
    rng = np.random.default_rng(0)
    with ClipWriter(path, (FRAMES, 8, 16), fingerprint="scan") as writer:
        for index in range(FRAMES):
            distance = _hits(poses[index, :3, 3], cylinders)
            seen = distance < 90
            points = RAYS[seen] * (distance[seen] + rng.normal(0, 0.015, np.count_nonzero(seen)))[:, None]
            rgb = np.zeros((8, 16, 3), np.float32)
            frame = GBuffer({"rgb": rgb}, camera=info.camera(index), time=index / 10)
            writer.write(index, frame, np.column_stack([points, np.ones(len(points))]).astype(np.float32))
        return writer.finish(info)


def _found(path: Path, cylinders: list[Cylinder], params: StreetLampParams = PARAMS) -> Array:
    lights = pole_lamps(_clip(path / "scan", cylinders), params, white_cd_m2=1.0)
    assert [light.name for light in lights] == [f"pole-{n + 1}" for n in range(len(lights))]
    return np.array([light.position for light in lights]).reshape(-1, 3)


def test_a_lamp_hangs_over_the_road_from_a_pole(tmp_path: Path) -> None:
    (lamp,) = _found(tmp_path, [POLE])
    np.testing.assert_allclose(lamp, (POLE[0] - 1, 6, POLE[1]), atol=0.15)


def test_mount_and_overhang_are_parameters(tmp_path: Path) -> None:
    params = replace(PARAMS, pole_mount_m=8.0, pole_overhang_m=2.0)
    (lamp,) = _found(tmp_path, [POLE], params)
    np.testing.assert_allclose(lamp, (POLE[0] - 2, 8, POLE[1]), atol=0.15)


def test_poles_in_a_row_keep_their_distance(tmp_path: Path) -> None:
    row: list[Cylinder] = [(side * 5.0, z, 0.08, 0.0, 8.0) for z, side in ((-72, 1), (-78, -1), (-84, 1), (-97, -1))]
    lamps = _found(tmp_path, row, replace(PARAMS, pole_spacing_m=11.5))
    np.testing.assert_allclose(lamps[:, 2], (-72, -84, -97), atol=0.15)
    assert (np.sign(lamps[:, 0]) == (1, 1, -1)).all()


NO_LAMPS: dict[str, list[Cylinder]] = {
    "nothing": [],
    "sign post": [(*POLE[:4], 2.8), (POLE[0], POLE[1], 0.3, 2.2, 2.9)],
    "high sign post": [(*POLE[:4], 3.3)],
    "trunk": [(5.0, -75.0, 0.3, 0.0, 8.0)],
    "thin trunk with a crown": [POLE, *((5 + dx, -75 + dz, 0.5, 2.8, 8.0) for dx in (-1, 1) for dz in (-0.7, 0.7))],
    "pole in a hedge": [POLE, *((5.0, -75 + dz, 0.3, 0.0, 2.0) for dz in (-1.5, -1, -0.5, 0.5, 1, 1.5))],
    "pole far from the road": [(19.0, -75.0, 0.08, 0.0, 8.0)],
    "pole on the road": [(0.5, -75.0, 0.08, 0.0, 8.0)],
    "wall": [(5.0, -50 - 0.3 * n, 0.25, 0.0, 8.0) for n in range(40)],
    "hanging": [(*POLE[:3], 2.5, 8.0)],
}


@pytest.mark.parametrize("name", NO_LAMPS)
def test_what_is_no_lamp_post(tmp_path: Path, name: str) -> None:
    assert len(_found(tmp_path, NO_LAMPS[name])) == 0


def test_a_clip_without_returns(tmp_path: Path) -> None:
    from aw4d.ingest import ingest
    from tests import made_up

    source = replace(made_up.source(2), points=lambda index: None)
    assert pole_lamps(ingest(source, tmp_path / "clip"), PARAMS, white_cd_m2=1.0) == []


@pytest.mark.clip
def test_trees_signs_and_fences_of_a_real_drive_carry_no_lamps(kitti_drive: Path, tmp_path: Path) -> None:
    from aw4d.io.kitti import open_kitti

    source = open_kitti(kitti_drive)
    info = source.info
    with ClipWriter(tmp_path / "drive", (len(info), info.height, info.width), fingerprint="drive") as writer:
        empty = np.zeros((info.height, info.width), np.bool_)
        for index in range(len(info)):
            frame = GBuffer({"sky": empty}, camera=info.camera(index), time=float(info.times[index]))
            writer.write(index, frame, source.points(index))
        clip = writer.finish(info)
    assert pole_lamps(clip, StreetLampParams(), white_cd_m2=1.0) == []
