"""Vehicle instances: made boxes and clusters, and real ones against human labels."""

from __future__ import annotations

import numpy as np
import pytest

from aw4d.boxes import Box
from aw4d.calibrate.ground import GroundPlane
from aw4d.camera import Camera
from aw4d.errors import InputError
from aw4d.extract.completion import complete_depth
from aw4d.extract.road import lane_ground
from aw4d.extract.sky import sky_mask
from aw4d.extract.vehicles import vehicle_ids
from tests.kitti_scan import CAR, label_iou, scan

H, W, HEIGHT = 160, 320, 1.6
CAMERA = Camera(width=W, height=H, K=np.array([[220.0, 0, 160], [0, 220, 60], [0, 0, 1]]))
GROUND = GroundPlane(normal=np.array([0.0, -1, 0]), offset=HEIGHT, inliers=1.0)
NOTHING = np.zeros((0, 3), np.float32)
NO_SKY = np.zeros((H, W), bool)
GREY = np.full((H, W, 3), 90, np.uint8)


def car(
    x: float, z: float, *, yaw: float = 0.0, track_id: int = 0, category: str = "Car", float_by: float = 0.0
) -> Box:
    """A car of 4.2 x 1.5 x 1.8 m, its middle at (x, z), facing away; camera frame = world."""
    forward = np.array([np.sin(yaw), 0, np.cos(yaw)])
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([forward, (0, -1, 0), np.cross(forward, (0, -1, 0))])
    pose[:3, 3] = (x, HEIGHT - 0.75 - float_by, z)
    return Box(track_id=track_id, category=category, object_to_world=pose, size=(4.2, 1.5, 1.8))


def empty_street():
    rows = CAMERA.rays()[..., 1]
    return np.where(rows > 0.02, HEIGHT / np.maximum(rows, 0.02), 80).astype(np.float32)


def ids_of(*boxes: Box, depth=None, sky=NO_SKY, ground=GROUND, points=NOTHING):
    depth = empty_street() if depth is None else depth
    return vehicle_ids(depth=depth, camera=CAMERA, boxes=boxes, points=points, ground=ground, sky=sky, rgb=GREY)


def test_the_silhouette_lies_in_the_boxs_and_fills_most_of_it():
    box = car(0, 12)
    mask = ids_of(box) > 0
    u, v, _ = CAMERA.project(CAMERA.to_camera(box.corners())).T
    rows, columns = np.nonzero(mask)
    assert u.min() - 1 <= columns.min() <= u.min() + 2
    assert u.max() - 2 <= columns.max() <= u.max() + 1
    assert v.min() - 1 <= rows.min()
    _, wheels_on_road, _ = CAMERA.project([0, HEIGHT, 12 - 0.3 * 4.2])
    assert rows.max() == pytest.approx(wheels_on_road, abs=1.5)
    assert 0.6 < np.count_nonzero(mask) / ((u.max() - u.min()) * (v.max() - v.min())) < 1


def test_the_id_is_the_track_and_outlasts_order_and_company():
    left, right = car(-3, 12, track_id=7), car(3, 14, track_id=2)
    both = ids_of(left, right)
    assert set(np.unique(both)) == {0, 8, 3}
    np.testing.assert_array_equal(both, ids_of(right, left))
    np.testing.assert_array_equal(both == 8, ids_of(left) == 8)


def test_the_nearer_car_hides_the_farther():
    ids = ids_of(car(0, 10, track_id=1), car(1, 20, track_id=2))
    alone = ids_of(car(0, 10, track_id=1))
    np.testing.assert_array_equal(ids == 2, alone == 2)
    assert (ids == 3).any()


def test_what_stands_in_front_is_not_the_car():
    depth = empty_street()
    depth[:, 155:165] = np.minimum(depth[:, 155:165], 4)
    ids = ids_of(car(0, 12), depth=depth)
    assert not ids[:80, 155:165].any()
    assert ids[:, 145:154].any()
    assert ids[:, 166:175].any()


@pytest.mark.parametrize("float_by", [-0.2, 0.1, 0.3])
def test_a_floating_box_is_set_on_the_ground(float_by):
    np.testing.assert_array_equal(ids_of(car(0, 12, float_by=float_by)), ids_of(car(0, 12)))


def test_without_ground_the_box_is_taken_as_it_is():
    assert np.nonzero(ids_of(car(0, 12, float_by=0.3), ground=None))[0].max() < np.nonzero(ids_of(car(0, 12)))[0].max()


@pytest.mark.parametrize("category", ["Pedestrian", "Cyclist", "barrier", "traffic_cone", "Misc"])
def test_other_objects_are_no_vehicles(category):
    assert not ids_of(car(0, 12, category=category)).any()


@pytest.mark.parametrize("category", ["Car", "Van", "Truck", "bus", "construction_vehicle", "vehicle.bus.rigid"])
def test_vehicles_of_every_kind(category):
    assert ids_of(car(0, 12, category=category)).any()


def test_the_sky_is_no_vehicle():
    assert not ids_of(car(0, 12), sky=~NO_SKY).any()


def test_boxes_behind_and_beside_the_camera_leave_no_trace():
    assert not ids_of(car(0, -10), car(40, 5)).any()


@pytest.mark.parametrize("yaw", [0.0, np.pi / 4, 2.0])
def test_a_box_that_straddles_the_near_plane_or_fills_the_picture(yaw):
    ids = ids_of(car(1.8, 2.0, yaw=yaw))
    assert (ids[:, W // 2 + 40 :] > 0).any()
    inside = ids_of(Box(track_id=0, category="Car", object_to_world=np.eye(4), size=(50, 20, 50)), ground=None)
    assert inside.shape == (H, W)


def test_a_box_of_zero_size_is_harmless():
    pose = car(0, 12).object_to_world
    flat = Box(track_id=0, category="Car", object_to_world=pose, size=(0, 0, 0))
    assert np.count_nonzero(ids_of(flat, ground=None)) < 60


def returns_from(box: Box) -> np.ndarray:
    """Returns from the two sides of a box that face the camera, and from the road around it."""
    length, height, width = box.size
    y, s = np.meshgrid(np.arange(0.3, 1.4, 0.1) - height / 2, np.linspace(-0.5, 0.5, 25))
    s = np.where(y > 0.2, 0.75 * s, s)  # the cabin is narrower than the body
    back = np.stack([np.full(y.shape, -length / 2), y, s * width], axis=-1)
    side = np.stack([s * length, y, np.full(y.shape, -width / 2)], axis=-1)
    local = np.concatenate([back.reshape(-1, 3), side.reshape(-1, 3)])
    body = local @ box.object_to_world[:3, :3].T + box.object_to_world[:3, 3]
    x, z = np.meshgrid(np.arange(-8, 8, 0.25), np.arange(5, 30, 0.25))
    road = np.stack([x, np.full(x.shape, HEIGHT), z], axis=-1).reshape(-1, 3)
    return np.concatenate([body, road]).astype(np.float32)


@pytest.mark.parametrize("yaw", [0.0, 0.2, -0.3])
def test_a_car_without_a_box_is_found(yaw):
    box = car(2, 15, yaw=yaw)
    found, given = ids_of(points=returns_from(box)) > 0, ids_of(box) > 0
    assert np.count_nonzero(found & given) / np.count_nonzero(found | given) > 0.7


def test_a_slab_of_a_cars_size_is_none():
    y, x = np.meshgrid(np.arange(0.1, 1.7, 0.1), np.arange(1, 4, 0.1))
    slab = np.stack([x, y, np.full(x.shape, 14.0)], axis=-1).reshape(-1, 3)
    road = returns_from(car(2, 15))[550:]
    assert not ids_of(points=np.concatenate([slab, road]).astype(np.float32)).any()


def test_a_car_with_a_box_is_not_found_again():
    box = car(2, 15, track_id=4)
    assert set(np.unique(ids_of(box, points=returns_from(box)))) == {0, 5}


def test_found_cars_are_numbered_after_the_boxes_from_left_to_right():
    known, left, right = car(0, 25, track_id=4), car(-3, 12), car(3, 12)
    ids = ids_of(known, points=np.concatenate([returns_from(left), returns_from(right)]))
    assert set(np.unique(ids)) == {0, 5, 6, 7}
    assert np.nonzero(ids == 6)[1].mean() < np.nonzero(ids == 7)[1].mean()


def test_walls_and_posts_are_no_cars():
    wall = np.stack(np.meshgrid([4.0], np.arange(-1.5, 1.5, 0.1), np.arange(6, 30, 0.2)), axis=-1).reshape(-1, 3)
    post = np.stack(np.meshgrid([-2.0, -1.9], np.arange(-3, 1.5, 0.05), [10.0]), axis=-1).reshape(-1, 3)
    points = np.concatenate([wall, post, returns_from(car(0, 60))[550:]]).astype(np.float32)
    assert not ids_of(points=points).any()


@pytest.mark.parametrize("name", ["depth", "sky", "rgb"])
def test_refuses_planes_of_another_size(name):
    planes = {"depth": empty_street(), "sky": NO_SKY, "rgb": GREY}
    planes[name] = planes[name][1:]
    with pytest.raises(InputError, match=f"{name}: expected a plane of"):
        vehicle_ids(camera=CAMERA, boxes=None, points=None, ground=None, **planes)


@pytest.mark.clip
@pytest.mark.parametrize("number", [20, 40])
def test_agrees_with_human_labels(kitti_drive, number):
    frame = scan(kitti_drive, number)
    sky = sky_mask(frame.rgb, camera=frame.camera, points=frame.points)
    ids = vehicle_ids(
        depth=complete_depth(frame.points, rgb=frame.rgb, camera=frame.camera, sky=sky),
        camera=frame.camera,
        boxes=frame.boxes,
        points=frame.points,
        ground=lane_ground(frame.points),
        sky=sky,
        rgb=frame.rgb,
    )
    assert label_iou(kitti_drive, number, ids > 0, CAR) >= 0.75
    assert {box.track_id + 1 for box in frame.boxes} <= set(np.unique(ids))
