"""Dense depth: planes stay planes, steps stay steps, and a real drive's hidden returns are met."""

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
from aw4d.extract.sky import sky_mask
from aw4d.extract.visibility import visible_returns
from tests.kitti_scan import scan

Array = NDArray[np.float64]
FRAMES = range(10, 67)


def camera_of(width: int, height: int) -> Camera:
    return Camera(width=width, height=height, K=np.array([[300.0, 0, width / 2], [0, 300.0, height / 3], [0, 0, 1]]))


def rings(camera: Camera, inverse_depth: Array, rows: Array) -> NDArray[np.float32]:
    """Returns along image rows, 1.5 px apart, of a scene given by the inverse depth of its pixels (H, W)."""
    u, v = (a.ravel() for a in np.meshgrid(np.arange(0.25, camera.width - 1, 1.5), rows))
    z = 1 / inverse_depth[np.rint(v).astype(int), np.rint(u).astype(int)]
    (fx, _, cx), (_, fy, cy) = camera.K[:2]
    rounded_u, rounded_v = np.rint(u), np.rint(v)
    return np.stack([(rounded_u - cx) / fx * z, (rounded_v - cy) / fy * z, z], axis=-1).astype(np.float32)


def grey(camera: Camera) -> NDArray[np.uint8]:
    return np.full((*camera.shape, 3), 128, dtype=np.uint8)


def no_sky(camera: Camera) -> NDArray[np.bool_]:
    return np.zeros(camera.shape, dtype=np.bool_)


@pytest.mark.parametrize("size", [(160, 96), (161, 97), (47, 53)])
@pytest.mark.parametrize("plane", [(0.0, 0.0, 0.05), (0.03, 0.0, 0.06), (0.02, 0.6, 0.02)])
def test_a_plane_is_reproduced(size: tuple[int, int], plane: tuple[float, float, float]) -> None:
    camera = camera_of(*size)
    rays = camera.rays()
    rows = np.arange(np.ceil(camera.K[1, 2]) + 4, camera.height, 6.0)  # 5 px apart, near rows would hide far ones
    inverse = np.maximum(rays @ np.array(plane), 1e-3)
    depth = complete_depth(rings(camera, inverse, rows), rgb=grey(camera), camera=camera, sky=no_sky(camera))
    inside = np.s_[int(rows[0]) + 1 : int(rows[-1]), 2:-2]
    np.testing.assert_allclose(depth[inside], 1 / inverse[inside], rtol=1e-3)


def test_the_ground_goes_on_below_the_lowest_ring() -> None:
    camera = camera_of(160, 120)
    inverse = np.maximum(camera.rays() @ np.array((0.0, 0.6, 0.0)), 1e-3)
    points = rings(camera, inverse, np.arange(48.0, 90.0, 5.0))
    depth = complete_depth(points, rgb=grey(camera), camera=camera, sky=no_sky(camera))
    np.testing.assert_allclose(depth[90:], 1 / inverse[90:], rtol=0.01)


def test_the_ground_goes_on_beyond_the_last_ring_where_nothing_was_struck() -> None:
    camera = camera_of(160, 120)
    inverse = np.maximum(camera.rays() @ np.array((0.0, 0.6, 0.0)), 1e-3)
    points = rings(camera, inverse, np.arange(52.0, 110.0, 5.0))  # the last ring lies at 41.7 m
    depth = complete_depth(points, rgb=grey(camera), camera=camera, sky=no_sky(camera))
    beyond = np.s_[46:52, 10:-10]  # to 83 m
    np.testing.assert_allclose(depth[beyond], 1 / inverse[beyond], rtol=0.05)


def two_walls(camera: Camera) -> tuple[Array, NDArray[np.uint8]]:
    """A wall at 8 m before one at 25 m, and their picture."""
    inverse, rgb = np.full(camera.shape, 1 / 25), grey(camera)
    inverse[:, 60:110] = 1 / 8
    rgb[:, 60:110] = (200, 60, 40)
    return inverse, rgb


def test_a_step_stays_a_step_at_the_edge_in_the_image() -> None:
    camera = camera_of(160, 96)
    inverse, rgb = two_walls(camera)
    points = rings(camera, inverse, np.arange(2.0, 95.0, 5.0))
    depth = complete_depth(points, rgb=rgb, camera=camera, sky=no_sky(camera))
    depth, inverse = depth[3:92], inverse[3:92]  # between the outermost rings
    near, far = np.abs(depth - 8) < 0.8, np.abs(depth - 25) < 2.5
    assert (~(near | far)).sum(axis=1).max() <= 8  # in no row do the two edges take more than 4 px each
    middle = 1 / depth > (1 / 8 + 1 / 25) / 2
    assert (middle != (inverse > 0.1)).sum(axis=1).max() <= 6  # and lie within 3 px of the edges in the image


def test_surfaces_go_on_upwards_as_far_as_the_image_shows_no_edge() -> None:
    camera = camera_of(160, 96)
    inverse, rgb = two_walls(camera)
    points = rings(camera, inverse, np.arange(50.0, 95.0, 5.0))
    depth = complete_depth(points, rgb=rgb, camera=camera, sky=no_sky(camera))
    np.testing.assert_allclose(depth[:50, 64:106], 8, rtol=0.1)
    np.testing.assert_allclose(depth[:50, :30], 25, rtol=0.1)
    assert (depth[:50, :57] > 2 * 8).all()  # the far wall stays far up to the edge


def test_a_return_behind_a_nearer_one_is_hidden() -> None:
    camera = camera_of(200, 100)
    pixels = np.array([(50, 50), (59, 50), (61, 50), (50, 54), (50, 56), (150, 50), (155, 50), (158, 50)], dtype=float)
    z = np.array([10, 20, 20, 20, 20, 10, 10.9, 11.4])
    points = (np.linalg.inv(camera.K) @ np.column_stack([pixels, np.ones(8)]).T * z).T.astype(np.float32)
    # 9 px across and 4 px down lie inside the ellipse, 11 and 6 outside; 0.9 m and then 14 % are too little.
    np.testing.assert_array_equal(
        visible_returns(points, camera=camera), [True, False, True, False, True, True, True, True]
    )


def test_returns_out_of_sight_are_not_visible() -> None:
    camera = camera_of(200, 100)
    points = np.array([(0, 0, -5), (np.nan, 0, 5), (100, 0, 5), (0, 0, 5)], dtype=np.float32)
    np.testing.assert_array_equal(visible_returns(points, camera=camera), [False, False, False, True])


def test_order_of_the_returns_does_not_matter() -> None:
    camera = camera_of(160, 96)
    inverse, rgb = two_walls(camera)
    points = rings(camera, inverse, np.arange(2.0, 95.0, 5.0))
    points = points[visible_returns(points, camera=camera)]
    first = complete_depth(points, rgb=rgb, camera=camera, sky=no_sky(camera))
    again = complete_depth(points, rgb=rgb, camera=camera, sky=no_sky(camera))
    np.testing.assert_array_equal(first, again)


@pytest.mark.parametrize("line", ["row", "point"])
def test_degenerate_scans_give_finite_depth(line: str) -> None:
    camera = camera_of(64, 48)
    u = np.linspace(-0.05, 0.05, 40) if line == "row" else np.zeros(40)
    points = np.column_stack([u * 10, np.full(40, 0.5), np.full(40, 10.0)]).astype(np.float32)
    depth = complete_depth(points, rgb=grey(camera), camera=camera, sky=no_sky(camera))
    assert np.isfinite(depth).all()
    np.testing.assert_allclose(depth, 10, rtol=0.2)


def test_bad_input_is_refused() -> None:
    camera = camera_of(64, 48)
    points = rings(camera, np.full(camera.shape, 0.1), np.arange(2.0, 47.0, 5.0))
    with pytest.raises(InputError, match="at least 10 returns"):
        complete_depth(points[:9], rgb=grey(camera), camera=camera, sky=no_sky(camera))
    with pytest.raises(InputError, match="points: expected"):
        complete_depth(points[:, :2], rgb=grey(camera), camera=camera, sky=no_sky(camera))
    with pytest.raises(InputError, match="rgb: expected"):
        complete_depth(points, rgb=grey(camera)[1:], camera=camera, sky=no_sky(camera))
    with pytest.raises(InputError, match="sky: expected"):
        complete_depth(points, rgb=grey(camera), camera=camera, sky=no_sky(camera).T)


def seen_by_the_rule(uvz: Array) -> NDArray[np.bool_]:
    """Returns (N, 3) that no other one in the ellipse of half axes 10 x 5 px hides; written for the judging alone."""
    neighbours = cKDTree(uvz[:, :2] / (10.0, 5.0)).query_ball_point(uvz[:, :2] / (10.0, 5.0), 1.0)
    nearest = np.array([uvz[index, 2].min() for index in neighbours])
    return ~((uvz[:, 2] - nearest > 1) & (uvz[:, 2] > 1.15 * nearest))


def hidden_errors(drive: Path, number: int) -> tuple[Array, Array]:
    """Errors [m] and true depths [m] of a fifth of the frame's returns, hidden from the completion."""
    frame = scan(drive, number)
    uvz = frame.camera.project(frame.points)
    u, v, z = uvz.T
    inside = (z > 0) & (u >= 0) & (v >= 0) & (u <= frame.camera.width - 1) & (v <= frame.camera.height - 1)
    points, uvz = frame.points[inside], uvz[inside]
    hidden = np.random.default_rng(number).random(len(points)) < 0.2
    sky = sky_mask(frame.rgb, camera=frame.camera, points=points[~hidden])
    depth = complete_depth(points[~hidden], rgb=frame.rgb, camera=frame.camera, sky=sky)
    u, v, z = uvz[hidden & seen_by_the_rule(uvz)].T
    # Read between the pixels, in inverse depth: a road's depth changes by more than the limits over half a pixel.
    read = cv2.remap(1 / depth, u.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR).ravel()
    return np.abs(1 / read - z), z


@pytest.mark.clip
def test_hidden_returns_of_a_real_drive_are_met(kitti_drive: Path) -> None:
    per_frame = [hidden_errors(kitti_drive, number) for number in FRAMES]
    error, z = (np.concatenate(parts) for parts in zip(*per_frame, strict=True))
    measured = f"MAE {error.mean():.4f} m, RMSE {np.sqrt((error**2).mean()):.4f} m, median {np.median(error / z):.5f}"
    print(measured)
    assert error.mean() <= 0.16, measured
    assert np.sqrt((error**2).mean()) <= 0.9, measured
    assert np.median(error / z) <= 0.0016, measured
