"""Materials by kind of surface: ranges, what the light's colour and strength do, and steadiness."""

from __future__ import annotations

import numpy as np
import pytest

from aw4d.colour import decode_srgb8
from aw4d.errors import InputError
from aw4d.extract.materials import ASPHALT, materials
from tests.kitti_scan import scan

H, W = 120, 200


def street(light=(1.0, 1.0, 1.0)) -> dict:
    """Sky, walls of mixed reflectance, a grey road and a dark car, all in one light; the truth is in `albedo`."""
    rng = np.random.default_rng(0)
    albedo = np.full((H, W, 3), 0.2)
    albedo[:, :, 1] += np.linspace(-0.05, 0.1, W)
    sky, road, vehicle = np.zeros((H, W), bool), np.zeros((H, W), bool), np.zeros((H, W), np.int32)
    sky[:30], road[70:], vehicle[60:90, 80:120] = True, True, 4
    albedo[road] = ASPHALT
    albedo[vehicle > 0] = 0.04
    albedo *= np.exp(rng.normal(0, 0.05, (H, W, 1)))
    normal = np.zeros((H, W, 3), np.float32)
    normal[:70, :, 2], normal[70:, :, 1] = -1, -1
    rgb = (albedo * np.array(light)).astype(np.float32)
    rgb[sky] = 3
    return {"rgb_linear": rgb, "sky": sky, "road": road, "vehicle": vehicle, "normal": normal, "albedo": albedo}


def guess(frame: dict) -> dict:
    return materials(frame["rgb_linear"], **{key: frame[key] for key in ("sky", "road", "vehicle", "normal")})


def test_planes_and_ranges():
    planes = guess(street())
    assert set(planes) == {"albedo", "roughness", "metallic"}
    assert planes["albedo"].shape == (H, W, 3)
    for values in planes.values():
        assert values.dtype == np.float32
        assert np.isfinite(values).all()
        assert values.min() >= 0
        assert values.max() <= 1


def test_each_kind_of_surface_has_its_roughness_and_none_is_metal():
    frame = street()
    planes = guess(frame)
    car, road = frame["vehicle"] > 0, frame["road"] & (frame["vehicle"] == 0)
    assert np.unique(planes["roughness"][car]).size == np.unique(planes["roughness"][road]).size == 1
    assert planes["roughness"][car][0] < planes["roughness"][road][0]
    assert not planes["metallic"].any()


def test_asphalt_gets_the_reflectance_of_asphalt_and_a_dark_car_stays_darker():
    frame = street()
    albedo = guess(frame)["albedo"]
    road = np.median(albedo[frame["road"] & (frame["vehicle"] == 0)])
    assert road == pytest.approx(ASPHALT, rel=0.25)
    assert np.median(albedo[frame["vehicle"] > 0]) < 0.8 * road


@pytest.mark.parametrize("light", [(5.0, 5.0, 5.0), (0.1, 0.1, 0.1), (1.4, 1.0, 0.6)])
def test_the_lights_strength_and_colour_are_divided_out(light):
    np.testing.assert_allclose(guess(street(light))["albedo"], guess(street())["albedo"], rtol=0.02, atol=1e-3)


@pytest.mark.parametrize("sky_light", [(0.05, 0.07, 0.1), (0.15, 0.2, 0.27)])
def test_a_blue_shadow_is_taken_out_of_road_and_wall(sky_light):
    frame = street()
    frame["rgb_linear"][30:, :70] *= np.array(sky_light, np.float32)
    albedo = guess(frame)["albedo"]
    for rows, least in ((slice(40, 55), 0.5), (slice(100, 120), 0.9)):
        seen = albedo[rows] / frame["albedo"][rows]
        assert least < np.median(seen[:, 10:50]) / np.median(seen[:, 150:190]) < 1.25


def test_a_grey_step_off_the_road_is_no_shadow():
    """Where the road shows no shadow, a dark wall stays dark beside a light one."""
    frame = street()
    frame["rgb_linear"][30:60, :70] *= 0.3
    albedo = guess(frame)["albedo"]
    assert np.median(albedo[35:55, 10:50]) < 0.7 * np.median(albedo[35:55, 150:190])


def test_paint_that_the_road_mask_leaves_out_is_as_bright_as_paint_in_it():
    frame = street()
    frame["rgb_linear"][80:105, 40:46] = 0.6
    whole = guess(frame)["albedo"]
    frame["road"][82:103, 41:45] = False
    np.testing.assert_array_equal(guess(frame)["albedo"], whole)


def test_the_same_frame_gives_the_same_planes():
    first, second = guess(street()), guess(street())
    for name, values in first.items():
        np.testing.assert_array_equal(values, second[name])


@pytest.mark.parametrize("fill", [0.0, 1.0, 1e5])
@pytest.mark.parametrize("masks", ["none", "all sky", "all road"])
def test_flat_pictures_and_full_masks(fill, masks):
    for shape in ((1, 1), (1, 9), (7, 13)):
        planes = materials(
            np.full((*shape, 3), fill, np.float32),
            sky=np.full(shape, masks == "all sky"),
            road=np.full(shape, masks == "all road"),
            vehicle=np.zeros(shape, np.int32),
            normal=np.broadcast_to(np.array([0, 0, -1], np.float32), (*shape, 3)),
        )
        assert all(np.isfinite(values).all() for values in planes.values())
        assert planes["albedo"].max() <= 1


@pytest.mark.parametrize("name", ["sky", "road", "vehicle", "normal"])
def test_refuses_planes_of_another_size(name):
    frame = street()
    frame[name] = frame[name][1:]
    with pytest.raises(InputError, match=f"{name}: expected a plane of"):
        guess(frame)


@pytest.mark.clip
def test_albedo_is_steady_from_frame_to_frame(kitti_drive):
    """No sky, road or cars told apart, so that what is measured is the estimate of the light alone."""
    medians = []
    for number in (20, 21, 22):
        rgb = decode_srgb8(scan(kitti_drive, number).rgb)[150:]
        none = np.zeros(rgb.shape[:2], bool)
        normal = np.broadcast_to(np.array([0, -1, 0], np.float32), rgb.shape)
        planes = materials(rgb, sky=none, road=none, vehicle=none.astype(np.int32), normal=normal)
        medians.append(np.median(planes["albedo"]))
    np.testing.assert_allclose(medians, medians[0], rtol=0.03)
