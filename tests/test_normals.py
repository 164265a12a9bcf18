"""Normals: exact on planes, crisp between them, smooth on a real road."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from aw4d.camera import Camera
from aw4d.errors import InputError
from aw4d.extract.completion import complete_depth
from aw4d.extract.normals import normals_from_depth
from aw4d.extract.sky import sky_mask
from tests.kitti_scan import ROAD, scan

Array = NDArray[np.float64]
CAMERA = Camera(width=161, height=97, K=np.array([[300.0, 0, 80], [0, 300.0, 30], [0, 0, 1]]))
NO_SKY = np.zeros(CAMERA.shape, dtype=np.bool_)


def depth_of(planes: list[tuple[float, float, float]]) -> NDArray[np.float32]:
    """The nearest of some planes (a, b, c), inverse depth a x + b y + c."""
    inverse = np.max([CAMERA.rays() @ np.array(plane) for plane in planes], axis=0)
    return (1 / np.maximum(inverse, 1e-3)).astype(np.float32)


def degrees(normal: NDArray[np.floating], truth: NDArray[np.floating]) -> Array:
    return np.degrees(np.arccos(np.clip((normal * truth).sum(axis=-1, dtype=np.float64), -1, 1)))


@pytest.mark.parametrize("plane", [(0.0, 0.0, 0.1), (0.05, 0.0, 0.1), (0.03, 0.1, 0.1), (0.0, 0.6, 0.01)])
def test_normals_of_a_plane(plane: tuple[float, float, float]) -> None:
    depth = depth_of([plane])
    normal = normals_from_depth(depth, camera=CAMERA, sky=NO_SKY)
    truth = -np.array(plane) / np.linalg.norm(plane)
    assert degrees(normal, truth)[depth < 100].max() < 0.5


def test_unit_and_facing_on_any_depth() -> None:
    depth = np.random.default_rng(3).uniform(1, 80, CAMERA.shape).astype(np.float32)
    sky = np.random.default_rng(4).random(CAMERA.shape) < 0.2
    normal = normals_from_depth(depth, camera=CAMERA, sky=sky)
    assert normal.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(normal, axis=-1), 1, atol=1e-5)
    assert ((normal * CAMERA.rays()).sum(axis=-1) <= 1e-6).all()


def test_a_wall_on_the_ground_keeps_its_foot_crisp() -> None:
    ground, wall = np.array((0.0, 0.6, 0.0)), np.array((0.0, 0.0, 0.1))
    depth = depth_of([tuple(ground), tuple(wall)])
    normal = normals_from_depth(depth, camera=CAMERA, sky=NO_SKY)
    foot = 30 + 300 / 6  # [px] row where 0.6 y = 0.1
    assert degrees(normal[: int(foot) - 6], -wall / 0.1).max() < 3
    assert degrees(normal[int(foot) + 7 :], -ground / 0.6).max() < 3


def test_a_step_does_not_bend_the_normals_beside_it() -> None:
    depth = np.full(CAMERA.shape, 20, dtype=np.float32)
    depth[:, 60:110] = 8
    normal = normals_from_depth(depth, camera=CAMERA, sky=NO_SKY)
    assert degrees(normal, np.array((0.0, 0.0, -1.0)))[:, np.r_[:59, 62:108, 112:161]].max() < 1


def test_columns_of_guessed_depth_leave_no_streaks() -> None:
    depth = np.full(CAMERA.shape, 20, dtype=np.float32)
    depth *= np.exp(np.random.default_rng(5).normal(0, 0.1, CAMERA.width)).astype(np.float32)
    guessed = np.ones(CAMERA.shape, dtype=np.bool_)
    normal = normals_from_depth(depth, camera=CAMERA, sky=NO_SKY, guessed=guessed)
    assert degrees(normal, normal[48, 80]).max() < 2
    assert normal[48, 80, 1] < -0.3  # up
    assert normal[48, 80, 2] < -0.7  # and to the eye


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (9, 1), (2, 2)])
def test_tiny_images(size: tuple[int, int]) -> None:
    camera = Camera(width=size[0], height=size[1], K=np.array([[50.0, 0, 0], [0, 50.0, 0], [0, 0, 1]]))
    depth = np.full(camera.shape, 5, dtype=np.float32)
    normal = normals_from_depth(depth, camera=camera, sky=np.zeros(camera.shape, dtype=np.bool_))
    assert degrees(normal, np.array((0.0, 0.0, -1.0))).max() < 0.5


def test_bad_input_is_refused() -> None:
    depth = np.full(CAMERA.shape, 5, dtype=np.float32)
    with pytest.raises(InputError, match="depth: expected"):
        normals_from_depth(depth.T, camera=CAMERA, sky=NO_SKY)
    with pytest.raises(InputError, match="depth: expected"):
        normals_from_depth(depth * 0, camera=CAMERA, sky=NO_SKY)
    with pytest.raises(InputError, match="sky: expected"):
        normals_from_depth(depth, camera=CAMERA, sky=NO_SKY[1:])


def road_planes(road_points: Array, eyes: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Normals (N, 3) of the least-squares planes of the road returns within 2 m, and where these span a plane.

    Ten returns or more, spread over more than 0.2 m (standard deviation) across their main direction: a single ring
    is a line, not a plane.
    """
    normals, spans = np.zeros_like(eyes), np.zeros(len(eyes), dtype=np.bool_)
    for i, index in enumerate(cKDTree(road_points).query_ball_point(eyes, 2.0)):
        if len(index) >= 10:
            values, vectors = np.linalg.eigh(np.cov(road_points[index].T))
            normals[i] = -np.sign(vectors[:, 0] @ eyes[i]) * vectors[:, 0]
            spans[i] = values[1] > 0.2**2
    return normals, spans


@pytest.mark.clip
@pytest.mark.parametrize("number", [20, 40])
def test_normals_of_a_real_road(kitti_drive: Path, number: int) -> None:
    frame = scan(kitti_drive, number)
    sky = sky_mask(frame.rgb, camera=frame.camera, points=frame.points)
    depth = complete_depth(frame.points, rgb=frame.rgb, camera=frame.camera, sky=sky)
    normal = normals_from_depth(depth, camera=frame.camera, sky=sky)

    path = kitti_drive / "semantic_gt" / f"{number:010d}_labelIds.png"
    road = np.asarray(cv2.imread(str(path), cv2.IMREAD_UNCHANGED)) == ROAD
    u, v, _ = np.rint(frame.camera.project(frame.points)).T
    inside = (u >= 0) & (v >= 0) & (u < frame.camera.width) & (v < frame.camera.height)
    pixel = v[inside].astype(int), u[inside].astype(int)
    road_points = frame.points[inside][road[pixel]].astype(np.float64)

    rows, columns = (a[::13] for a in np.nonzero(road))
    truth, spans = road_planes(road_points, frame.camera.unproject(depth)[rows, columns])
    angle = degrees(normal[rows, columns], truth)[spans]
    measured = f"median {np.median(angle):.2f}, 95th percentile {np.percentile(angle, 95):.2f} degrees"
    print(measured)
    assert np.count_nonzero(spans) > 1000
    assert np.median(angle) <= 2, measured
    assert np.percentile(angle, 95) <= 6, measured
