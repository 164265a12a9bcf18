"""Road mask: a made street between two verges, and a real one against human labels."""

from __future__ import annotations

import numpy as np
import pytest

from aw4d.camera import Camera
from aw4d.errors import InputError
from aw4d.extract.completion import complete_depth
from aw4d.extract.normals import normals_from_depth
from aw4d.extract.road import lane_ground, road_mask
from aw4d.extract.sky import sky_mask
from tests.kitti_scan import ROAD, label_iou, scan

H, W, HEIGHT, KERB = 160, 320, 1.6, 0.15
CAMERA = Camera(width=W, height=H, K=np.array([[220.0, 0, 160], [0, 220, 60], [0, 0, 1]]))
EDGES = (-3.0, 5.0)  # [m] of the road


def street(*, kerb: float = KERB, shadow: bool = False) -> dict:
    """A road with verges `kerb` higher than it, walls 12 m aside, under a sky; the road is grey, the verges green."""
    rays = CAMERA.rays()
    down = np.maximum(rays[..., 1], 1e-9)
    on_road = HEIGHT / down
    x = rays[..., 0] * on_road
    road = (x > EDGES[0]) & (x < EDGES[1]) & (rays[..., 1] > 0)
    ground = np.where(road, on_road, (HEIGHT - kerb) / down)
    wall = 12 / np.maximum(np.abs(rays[..., 0]), 1e-9)
    depth = np.minimum(np.minimum(ground, wall), 100)
    standing = (wall <= ground) & (depth < 100)
    sky = (depth >= 100) & (rays[..., 1] <= 0)
    normal = np.zeros((H, W, 3))
    normal[..., 1] = -1
    normal[standing] = (1, 0, 0)
    normal[standing & (rays[..., 0] > 0)] = (-1, 0, 0)
    normal[sky] = (0, 0, -1)
    rgb = np.where(road[..., None], (110, 110, 112), (70, 110, 40)).astype(np.float64)
    rgb[standing], rgb[sky] = (150, 120, 90), (120, 170, 240)
    if shadow:
        rgb[:, 100:180] *= 0.35
    rgb += np.random.default_rng(0).normal(0, 4, (H, W, 1))
    near = road & (depth < 60)
    return {
        "rgb": np.clip(rgb, 0, 255).astype(np.uint8),
        "depth": depth.astype(np.float32),
        "normal": normal.astype(np.float32),
        "sky": sky,
        "truth": near,
        "judged": (depth < 60) | sky,
    }


def points_of(depth, step: int = 3):
    surface = CAMERA.unproject(depth)[::step, ::step].reshape(-1, 3)
    return surface[surface[:, 2] < 60].astype(np.float32)


def mask_iou(frame: dict, **changes) -> float:
    given = {"points": points_of(frame["depth"]), **{k: frame[k] for k in ("rgb", "depth", "normal", "sky")}, **changes}
    mask = road_mask(given.pop("rgb"), camera=CAMERA, **given)
    inside = mask & frame["judged"]
    return np.count_nonzero(inside & frame["truth"]) / np.count_nonzero(inside | frame["truth"])


@pytest.mark.parametrize("shadow", [False, True])
@pytest.mark.parametrize("kerb", [0.0, KERB])
def test_road_between_verges(kerb, shadow):
    assert mask_iou(street(kerb=kerb, shadow=shadow)) > 0.9


def test_a_kerb_tells_a_pavement_of_the_roads_colour():
    frame = street(kerb=0.25)
    rgb = frame["rgb"].copy()
    rgb[rgb[..., 1] > rgb[..., 0] + 20] = (110, 110, 112)
    assert mask_iou(frame, rgb=rgb) > 0.8


def test_reflectance_tells_a_level_verge_of_the_roads_colour():
    frame = street(kerb=0.0)
    grey = np.full((H, W, 3), 110, np.uint8)
    points = points_of(frame["depth"], 2)
    x, up = points[:, 0], HEIGHT - points[:, 1]
    on_road = (x > EDGES[0]) & (x < EDGES[1]) & (up < 0.05)
    reflectance = np.where(on_road, 0.2, 0.4).astype(np.float32)
    without = mask_iou(frame, rgb=grey, points=points)
    assert mask_iou(frame, rgb=grey, points=points, reflectance=reflectance) > max(0.8, without + 0.1)


def test_without_points_the_depth_plane_gives_the_ground():
    assert mask_iou(street(), points=None) > 0.9


def test_depth_that_is_a_plane_everywhere_leaves_it_to_colour():
    frame = street(kerb=0.0)
    depth = np.minimum(HEIGHT / np.maximum(CAMERA.rays()[..., 1], 1e-3), 200).astype(np.float32)
    normal = np.broadcast_to(np.array([0, -1, 0], np.float32), (H, W, 3))
    assert mask_iou(frame, depth=depth, normal=normal, points=None) > 0.8


def test_nothing_above_the_road_or_in_the_sky_is_road():
    frame = street()
    mask = road_mask(
        frame["rgb"], camera=CAMERA, depth=frame["depth"], normal=frame["normal"], points=None, sky=frame["sky"]
    )
    height = HEIGHT - CAMERA.unproject(frame["depth"])[..., 1]
    assert not mask[frame["sky"]].any()
    assert not mask[height > 1].any()


def test_without_level_ground_there_is_no_road():
    frame = street()
    wall = np.full((H, W), 8, np.float32)
    none = np.zeros((H, W), bool)
    assert not road_mask(frame["rgb"], camera=CAMERA, depth=wall, normal=frame["normal"], points=None, sky=none).any()
    assert not road_mask(frame["rgb"], camera=CAMERA, depth=wall, normal=frame["normal"], points=None, sky=~none).any()
    assert lane_ground(np.zeros((0, 3), np.float32)) is None
    assert lane_ground(None) is None


def test_lane_ground_is_the_lane_and_not_the_verge():
    ground = lane_ground(points_of(street()["depth"]))
    assert ground is not None
    assert ground.offset == pytest.approx(HEIGHT, abs=0.02)


@pytest.mark.parametrize("name", ["rgb", "depth", "normal", "sky"])
def test_refuses_planes_of_another_size(name):
    frame = street()
    planes = {key: frame[key] for key in ("rgb", "depth", "normal", "sky")}
    planes[name] = planes[name][1:]
    with pytest.raises(InputError, match=f"{name}: expected a plane of"):
        road_mask(planes.pop("rgb"), camera=CAMERA, points=None, **planes)


@pytest.mark.clip
@pytest.mark.parametrize("number", [20, 40])
def test_agrees_with_human_labels(kitti_drive, number):
    frame = scan(kitti_drive, number)
    sky = sky_mask(frame.rgb, camera=frame.camera, points=frame.points)
    depth = complete_depth(frame.points, rgb=frame.rgb, camera=frame.camera, sky=sky)
    normal = normals_from_depth(depth, camera=frame.camera, sky=sky)
    mask = road_mask(
        frame.rgb,
        camera=frame.camera,
        depth=depth,
        normal=normal,
        points=frame.points,
        sky=sky,
        reflectance=frame.reflectance,
    )
    assert label_iou(kitti_drive, number, mask, ROAD) >= 0.80


@pytest.mark.clip
def test_camera_height_of_the_recording_car(kitti_drive):
    """KITTI's cameras are mounted 1.65 m above the ground (Geiger et al. 2013, figure 3)."""
    for number in (12, 20, 40, 60):
        ground = lane_ground(scan(kitti_drive, number).points)
        assert ground is not None
        assert ground.offset == pytest.approx(1.65, abs=0.05)
