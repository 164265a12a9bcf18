"""Sky mask: made scenes with a known sky, and a real one against human labels."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from aw4d.camera import Camera
from aw4d.errors import InputError
from aw4d.extract.sky import sky_mask
from tests.kitti_scan import SKY, label_iou, scan

H, W = 180, 320
CAMERA = Camera(width=W, height=H, K=np.array([[260.0, 0, 160], [0, 260, 90], [0, 0, 1]]))
BLUE, OVERCAST = (90, 150, 230), (200, 205, 210)


def scene(colour=BLUE) -> np.ndarray:
    """Sky down to row 80, brighter towards the horizon; below it grey-brown ground with texture."""
    rgb = np.zeros((H, W, 3))
    rgb[:80] = np.array(colour) + np.linspace(0, 20, 80)[:, None, None]
    rgb[80:] = np.array((95, 90, 70)) + np.random.default_rng(0).normal(0, 12, (H - 80, W, 1))
    return np.clip(rgb, 0, 255).astype(np.uint8)


def iou(a, b) -> float:
    return np.count_nonzero(a & b) / np.count_nonzero(a | b)


@pytest.mark.parametrize("colour", [BLUE, OVERCAST, (235, 235, 235)])
def test_open_sky_is_found_whole(colour):
    truth = np.arange(H)[:, None] < np.full(W, 80)
    assert iou(sky_mask(scene(colour), camera=CAMERA, points=None), truth) > 0.97


def test_a_building_before_the_sky_is_not_sky():
    rgb = scene()
    rgb[30:80, 100:160] = (225, 215, 190)
    mask = sky_mask(rgb, camera=CAMERA, points=None)
    assert not mask[34:, 104:156].any()
    assert mask[:26].all()


def test_gaps_in_a_crown_are_sky_and_its_leaves_are_not():
    rgb = scene()
    rgb[20:80, 180:260] = (40, 60, 20)
    rgb[40:50, 210:222] = scene()[40:50, 210:222]
    mask = sky_mask(rgb, camera=CAMERA, points=None)
    assert mask[42:48, 212:220].all()
    assert not mask[55:, 184:256].any()


def test_wires_are_not_sky():
    rgb = scene()
    rgb[30:32] = (40, 40, 40)
    mask = sky_mask(rgb, camera=CAMERA, points=None)
    assert not mask[30:32].any()
    assert mask[:26].all()
    assert mask[36:75].all()


@pytest.mark.parametrize("beam_step", [2, 6])
def test_returns_prove_that_a_white_wall_is_not_sky(beam_step):
    rgb = scene((235, 235, 235))
    wall = np.s_[40:80, 40:140]
    v, u = np.mgrid[40:80:beam_step, 40:140:3]
    z = 12.0
    points = np.stack([(u - 160) / 260 * z, (v - 90) / 260 * z, np.full(u.shape, z)], axis=-1).reshape(-1, 3)
    assert sky_mask(rgb, camera=CAMERA, points=None)[wall].all(), "nothing in the picture tells it"
    assert not sky_mask(rgb, camera=CAMERA, points=points.astype(np.float32))[wall].any()
    assert sky_mask(rgb, camera=CAMERA, points=points.astype(np.float32))[:30].all()


def test_a_bright_road_is_not_sky():
    rgb = scene()
    rgb[100:] = (235, 238, 240)
    assert not sky_mask(rgb, camera=CAMERA, points=None)[100:].any()


@pytest.mark.parametrize("value", [0, 20, 60])
def test_a_dark_picture_has_no_daylight_sky(value):
    assert not sky_mask(np.full((H, W, 3), value, np.uint8), camera=CAMERA, points=None).any()


@pytest.mark.parametrize(("height", "width"), [(1, 1), (1, 40), (40, 1), (7, 13)])
def test_odd_sizes(height, width):
    camera = Camera(width=width, height=height, K=np.array([[50.0, 0, width / 2], [0, 50, height], [0, 0, 1]]))
    mask = sky_mask(np.full((height, width, 3), BLUE, np.uint8), camera=camera, points=None)
    assert mask.shape == (height, width)
    assert mask.dtype == np.bool_


def test_points_behind_the_camera_and_none_at_all_are_allowed():
    behind = np.array([[0, 0, -5]], np.float32)
    for points in (behind, np.zeros((0, 3), np.float32)):
        np.testing.assert_array_equal(
            sky_mask(scene(), camera=CAMERA, points=points), sky_mask(scene(), camera=CAMERA, points=None)
        )


@pytest.mark.parametrize("rgb", [np.zeros((H, W), np.uint8), np.zeros((H, W, 3)), np.zeros((H, W + 1, 3), np.uint8)])
def test_refuses_another_picture(rgb):
    with pytest.raises(InputError, match="rgb: expected"):
        sky_mask(rgb, camera=CAMERA, points=None)


@pytest.mark.clip
@pytest.mark.parametrize("with_laser", [True, False])
@pytest.mark.parametrize("number", [20, 40])
def test_agrees_with_human_labels(kitti_drive, number, with_laser):
    frame = scan(kitti_drive, number)
    mask = sky_mask(frame.rgb, camera=frame.camera, points=frame.points if with_laser else None)
    assert label_iou(kitti_drive, number, mask, SKY) >= 0.90


@pytest.mark.clip
@pytest.mark.parametrize("name", ["yolop_3c0e7240-96e390d2", "twin_caeb782d-4a20b7c4", "yolop_7dd9ef45-f197db95"])
def test_other_cameras(test_data, name):
    """A sky mask of another recording lies in the upper half and is bright."""
    path = test_data / "bdd100k" / f"{name}.jpg"
    rgb = cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2RGB)
    height, width = rgb.shape[:2]
    K = np.array([[0.8 * width, 0, width / 2], [0, 0.8 * width, height / 2], [0, 0, 1]])
    mask = sky_mask(rgb, camera=Camera(width=width, height=height, K=K), points=None)
    assert not mask[int(0.6 * height) :].any()
    if mask.any():
        assert rgb[mask].mean() > 1.3 * rgb[~mask].mean()
