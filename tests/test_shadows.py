"""Cast shadows: found on exact and on recorded pictures, and gone from the albedo, with no harm to what is painted."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from aw4d import street
from aw4d.colour import LUMINANCE, decode_srgb8
from aw4d.extract.frame import extract_frame
from aw4d.extract.materials import materials
from aw4d.extract.shadows import from_tones, shadow_matte, sunlight, tones
from aw4d.extract.shadows_road import road_albedo
from tests.kitti_scan import scan

Box = tuple[int, int, int, int]  # centre column and row, width and height [px]

# Frame of the drive, asphalt in the shadow of trees or cars, asphalt in the sun beside it: deep in the shadow and at
# its border, 6 to 23 m away.
SHADOWS: list[tuple[int, Box, Box]] = [
    (20, (512, 295, 24, 8), (512, 311, 24, 8)),
    (20, (543, 351, 24, 8), (515, 351, 24, 8)),
    (20, (674, 228, 16, 6), (704, 228, 16, 6)),
    (20, (949, 300, 24, 8), (977, 300, 24, 8)),
    (20, (588, 285, 16, 6), (608, 285, 16, 6)),
    (20, (520, 280, 24, 8), (540, 320, 24, 8)),
    (20, (600, 240, 24, 8), (720, 240, 24, 8)),
    (20, (540, 366, 24, 8), (600, 340, 24, 8)),
    (30, (700, 340, 24, 8), (890, 340, 24, 8)),
    (30, (765, 287, 24, 8), (803, 287, 24, 8)),
    (30, (822, 309, 24, 8), (850, 309, 24, 8)),
    (30, (587, 244, 24, 8), (587, 228, 24, 8)),
    (30, (624, 237, 16, 6), (624, 223, 16, 6)),
    (30, (567, 282, 16, 6), (567, 296, 16, 6)),
    (30, (968, 351, 24, 8), (940, 351, 24, 8)),
    (40, (560, 340, 24, 8), (560, 285, 24, 8)),
    (40, (591, 309, 24, 8), (591, 293, 24, 8)),
    (40, (406, 317, 16, 6), (436, 317, 16, 6)),
    (40, (811, 366, 24, 8), (849, 366, 24, 8)),
    (40, (441, 366, 12, 4), (441, 354, 12, 4)),
]
# Frame, paint in the sun, asphalt in the sun beside it.
PAINT: list[tuple[int, Box, Box]] = [
    (20, (727, 287, 5, 3), (752, 287, 9, 3)),
    (40, (650, 277, 5, 3), (672, 277, 9, 3)),
    (40, (620, 244, 3, 3), (633, 244, 7, 3)),
    (50, (577, 278, 5, 3), (600, 278, 9, 3)),
    (50, (603, 352, 7, 3), (630, 352, 9, 3)),
]


@lru_cache(maxsize=4)
def recorded(drive: Path, number: int) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_]]:
    """Luminance of the picture and of the albedo, and the road, of a frame of the drive."""
    s = scan(drive, number)
    points = np.column_stack([s.points, s.reflectance])
    planes = extract_frame(s.rgb, camera=s.camera, points=points, boxes=s.boxes, given={})
    return decode_srgb8(s.rgb) @ LUMINANCE, planes["albedo"] @ LUMINANCE, planes["road"]


def mean(plane: NDArray[np.float32], box: Box) -> float:
    x, y, width, height = box
    left, top = x - width // 2, y - height // 2
    return float(plane[top : top + height, left : left + width].mean())


@pytest.mark.clip
@pytest.mark.parametrize(("number", "shadowed", "lit"), SHADOWS)
def test_asphalt_is_the_same_in_a_recorded_shadow_and_in_the_sun(kitti_drive, number, shadowed, lit):
    rgb, albedo, _ = recorded(kitti_drive, number)
    assert 0.05 <= mean(rgb, shadowed) / mean(rgb, lit) <= 0.12
    assert 0.7 <= mean(albedo, shadowed) / mean(albedo, lit) <= 1.3


@pytest.mark.clip
@pytest.mark.parametrize(("number", "paint", "asphalt"), PAINT)
def test_recorded_paint_keeps_its_contrast(kitti_drive, number, paint, asphalt):
    rgb, albedo, _ = recorded(kitti_drive, number)
    source, kept = (mean(plane, paint) / mean(plane, asphalt) - 1 for plane in (rgb, albedo))
    assert source > 0.5
    assert kept >= 0.6 * source


@lru_cache(maxsize=2)
def drawn(index: int) -> dict:
    frame = street.frame(index, width=640, height=352)
    planes = {name: frame[name] for name in ("rgb", "albedo", "sky", "road", "vehicle", "normal")}
    planes["shadow"] = street.shadow(index, width=640, height=352)
    regions = {name: planes[name] for name in ("sky", "road", "vehicle", "normal")}
    planes["guess"] = materials(planes["rgb"], **regions)["albedo"]
    return planes


def kinds(planes: dict) -> dict[str, NDArray[np.bool_]]:
    road = planes["road"] & (planes["vehicle"] == 0)
    rest = ~planes["sky"] & ~planes["road"] & (planes["vehicle"] == 0)
    level = planes["normal"][..., 1] < -0.8
    return {"road": road, "pavement": rest & level, "walls": rest & ~level, "cars": planes["vehicle"] > 0}


def spread(planes: dict, name: str, mask: NDArray[np.bool_]) -> float:
    """Standard deviation of the log error of a plane taken for albedo: 0 if it is right but for its scale."""
    values, truth = (np.log(np.maximum(planes[plane][mask] @ LUMINANCE, 1e-3)) for plane in (name, "albedo"))
    return float(np.std(values - truth))


@pytest.mark.parametrize("index", [0, 20])
@pytest.mark.parametrize(("kind", "share"), [("road", 0.3), ("pavement", 0.7), ("walls", 0.75), ("cars", 0.85)])
def test_albedo_of_the_street_comes_nearer_to_the_truth_than_the_picture(index, kind, share):
    planes = drawn(index)
    mask = kinds(planes)[kind]
    assert spread(planes, "guess", mask) < share * spread(planes, "rgb", mask)


@pytest.mark.parametrize("index", [0, 20])
@pytest.mark.parametrize(("kind", "overlap"), [("road", 0.85), ("walls", 0.5)])
def test_shadows_of_the_street_are_found(index, kind, overlap):
    planes = drawn(index)
    standing = ~planes["sky"] & (planes["vehicle"] == 0)
    sun = sunlight(planes["rgb"], kinds(planes)["road"])
    assert sun is not None
    assert sun.certainty == 1
    mask = kinds(planes)[kind]
    found, true = (shadow_matte(planes["rgb"], standing, sun) > 0.5)[mask], planes["shadow"][mask]
    assert np.count_nonzero(found & true) / np.count_nonzero(found | true) > overlap


@pytest.mark.parametrize("index", [0, 20])
def test_no_bright_or_dark_line_along_the_shadows_of_the_street(index):
    """Error of log albedo on the road within 2 px of the border of a shadow, apart from paint: no bias, few strays."""
    planes = drawn(index)
    shadow = planes["shadow"].astype(np.float32)
    border = np.zeros(shadow.shape, bool)
    for axis in (0, 1):
        for shift in (-2, -1, 1, 2):
            border |= np.roll(shadow, shift, axis) != shadow
    truth = planes["albedo"] @ LUMINANCE
    plain = kinds(planes)["road"] & (truth < 0.22)
    error = np.log(np.maximum(planes["guess"] @ LUMINANCE, 1e-3) / np.maximum(truth, 1e-3))
    assert abs(np.median(error[plain & border]) - np.median(error[plain & ~border])) < 0.06
    assert np.percentile(np.abs(error[plain & border] - np.median(error[plain])), 95) < 0.4


def made_up(light: tuple[float, float, float], sky: tuple[float, float, float]) -> tuple:
    """Asphalt under light with a soft-edged shadow, a stripe of paint through both; picture, truth, shadow."""
    height, width = 160, 240
    grain = np.exp(np.random.default_rng(3).normal(0, 0.04, (height, width, 1)))
    truth = np.full((height, width, 3), 0.12) * grain
    truth[:, 150:156] = 0.6
    sun = np.clip((np.arange(width) - 100) / 6 + 0.5, 0, 1)[None, :, None] * np.ones((height, 1, 1))
    sun[60:110, 140:200] = 0
    return (truth * (sun * light + np.array(sky))).astype(np.float32), truth, sun[..., 0] == 0


def test_a_soft_shadow_goes_and_paint_in_it_stays():
    rgb, truth, shadow = made_up((1.6, 1.5, 1.4), (0.12, 0.16, 0.22))
    road = np.ones(shadow.shape, bool)
    sun = sunlight(rgb, road)
    assert sun is not None
    relative = road_albedo(rgb, road, sun) @ LUMINANCE
    plain = truth[..., 0] < 0.3
    assert np.median(relative[shadow & plain]) == pytest.approx(np.median(relative[~shadow & plain]), rel=0.05)
    for mask in (shadow, ~shadow):
        assert np.median(relative[mask & ~plain]) / np.median(relative[mask & plain]) > 0.6 * 5


def test_an_even_light_has_no_shadows():
    rgb, _, shadow = made_up((0, 0, 0), (0.5, 0.5, 0.5))
    sun = sunlight(rgb, np.ones(shadow.shape, bool))
    assert sun is not None
    assert sun.certainty == 0
    assert not sun.step.any()


def test_too_little_asphalt_tells_nothing():
    assert sunlight(np.ones((50, 60, 3), np.float32), np.zeros((50, 60), bool)) is None


def test_a_dark_car_is_not_brightened_by_shadows_elsewhere():
    """A car keeps its darkness against the lit road beside it."""
    rgb, _, shadow = made_up((1.6, 1.5, 1.4), (0.12, 0.16, 0.22))
    vehicle = np.zeros(shadow.shape, np.int32)
    vehicle[20:50, 170:220] = 1
    rgb[vehicle > 0] = (0.02, 0.02, 0.022)
    none = np.zeros(shadow.shape, bool)
    normal = np.broadcast_to(np.array([0, -1, 0], np.float32), rgb.shape)
    albedo = materials(rgb, sky=none, road=~none, vehicle=vehicle, normal=normal)["albedo"]
    assert np.median(albedo[vehicle > 0]) < 0.06


def test_tones_are_undone():
    rgb = np.random.default_rng(0).uniform(0.01, 1, (20, 3)).astype(np.float32)
    np.testing.assert_allclose(from_tones(tones(rgb)), rgb, rtol=1e-5)
