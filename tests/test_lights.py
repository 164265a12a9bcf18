"""Lights: read from JSON with errors that name the entry, seen in the camera, held by balls."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aw4d.camera import Camera
from aw4d.errors import InputError
from aw4d.lights.ego import headlights
from aw4d.lights.light import Light, balls, in_camera, read_lights, switched_on
from aw4d.lights.photometry import on_picture
from aw4d.params import RGB, HeadlightParams, LightParams, Params, StreetLampParams, VehicleLightParams
from tests.conftest import ROOT

K = np.array([[100.0, 0, 50], [0, 100, 40], [0, 0, 1]])


def _file(path: Path, content: Any) -> Path:
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


def test_a_file_of_lights(tmp_path: Path) -> None:
    entry = {"kind": "spot", "position": [1, 2, 3], "intensity": [4, 5, 6], "outer_deg": 40}
    (light,) = read_lights(_file(tmp_path / "lamps.json", [entry]))
    assert light == Light(kind="spot", position=(1, 2, 3), intensity=(4, 5, 6), outer_deg=40, name="file-1")


def test_lights_of_a_file_have_names(tmp_path: Path) -> None:
    entries = [{"kind": "point"}, {"kind": "point", "name": "kiosk"}, {"kind": "point"}]
    assert [light.name for light in read_lights(_file(tmp_path / "lamps.json", entries))] == [
        "file-1",
        "kiosk",
        "file-3",
    ]


@pytest.mark.parametrize(
    ("off", "left"),
    [
        ("", "street-1 street-12 vehicle-1-head-left vehicle-12-head-left ego-left"),
        ("street-1", "street-12 vehicle-1-head-left vehicle-12-head-left ego-left"),
        (" street , ego-left,", "vehicle-1-head-left vehicle-12-head-left"),
        ("vehicle-1", "street-1 street-12 vehicle-12-head-left ego-left"),
        ("left", "street-1 street-12 vehicle-1-head-left vehicle-12-head-left ego-left"),
    ],
)
def test_lights_are_switched_off_by_id(off: str, left: str) -> None:
    names = ["street-1", "street-12", "vehicle-1-head-left", "vehicle-12-head-left", "ego-left"]
    assert [light.name for light in switched_on([Light(kind="point", name=n) for n in names], off)] == left.split()


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        (1, "light 0: expected an object with a kind, got 1"),
        ({}, "light 0: expected an object with a kind"),
        ({"kind": "point", "intensty": [1, 1, 1]}, "intensty"),
        ({"kind": "point", "intensity": 5}, "intensity: expected three numbers, got 5"),
        ({"kind": "point", "intensity": [1, 2]}, "intensity: expected three"),
        ({"kind": "point", "r_max_m": [1, 2, 3]}, "r_max_m: expected a number"),
        ({"kind": 3}, "kind: expected text"),
        ({"kind": "point", "name": 3}, "name: expected text"),
        ({"kind": "laser"}, "kind"),
    ],
)
def test_a_wrong_entry_is_named(tmp_path: Path, entry: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_lights(_file(tmp_path / "lamps.json", [entry]))


def test_a_file_that_is_not_there_or_no_list(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        read_lights(tmp_path / "none.json")
    with pytest.raises(InputError, match="expected a JSON list of lights, got dict"):
        read_lights(_file(tmp_path / "lamps.json", {}))


def test_world_lights_move_against_the_camera_and_its_own_do_not() -> None:
    pose = np.diag([1.0, -1, -1, 1])  # level, looking along -z
    pose[:3, 3] = (10, 2, -5)
    camera = Camera(width=100, height=80, K=K, camera_to_world=pose)
    world = Light(kind="spot", position=(10, 5, -12), direction=(0, -2, 0))
    own = Light(kind="spot", position=(0.5, 0.9, 1), direction=(0, 0, 1), frame="camera")
    arrays = in_camera([world, own], camera)
    np.testing.assert_allclose(arrays.light_position, [[0, -3, 7], [0.5, 0.9, 1]], atol=1e-6)
    np.testing.assert_allclose(arrays.light_direction, [[0, 1, 0], [0, 0, 1]], atol=1e-6)


def test_headlights_are_a_pair_that_can_be_switched_off() -> None:
    left, right = headlights(HeadlightParams(), white_cd_m2=12)
    assert left.position[0] == -right.position[0] < 0
    assert (left.name, right.name) == ("ego-left", "ego-right")
    assert headlights(HeadlightParams(on=False), white_cd_m2=12) == []


def _luminance(light: Light) -> float:
    return float(np.dot(light.intensity, (0.2126, 0.7152, 0.0722)))


def test_headlights_have_candela_over_the_white_of_the_picture() -> None:
    assert _luminance(headlights(HeadlightParams(), white_cd_m2=12)[0]) == pytest.approx(20_000 / 12)
    assert _luminance(headlights(HeadlightParams(), white_cd_m2=100)[0]) == pytest.approx(200)


def test_the_high_beam_is_stronger_straight_and_reaches_farther() -> None:
    low, high = (headlights(HeadlightParams(beam=beam), white_cd_m2=12)[0] for beam in ("low", "high"))
    assert _luminance(high) == pytest.approx(3 * _luminance(low))
    assert np.rad2deg(np.arcsin(low.direction[1])) == pytest.approx(1)
    assert high.direction == (0, 0, 1)
    assert high.r_max_m > low.r_max_m


def test_what_is_given_goes_before_what_the_beam_says() -> None:
    params = HeadlightParams(beam="high", candela=1000, pitch_deg=2)
    assert (params.candela, params.pitch_deg, params.r_max_m) == (1000, 2, 120)
    with pytest.raises(InputError, match="beam: expected low or high"):
        HeadlightParams(beam="dim")  # type: ignore[arg-type]


@pytest.mark.parametrize("color", [(1.0, 0.5, 0.1), (1.0, 0.0, 0.0), (0.2, 0.2, 0.2)])
def test_a_colour_does_not_change_the_candela(color: RGB) -> None:
    rgb = on_picture(300.0, color, 10.0)
    assert np.dot(rgb, (0.2126, 0.7152, 0.0722)) == pytest.approx(30)
    np.testing.assert_allclose(np.array(rgb) * color[0], np.array(color) * rgb[0])


def test_a_black_lamp_is_dark() -> None:
    assert on_picture(300.0, (0.0, 0.0, 0.0), 10.0) == (0, 0, 0)


@pytest.mark.parametrize("params", [LightParams, StreetLampParams, VehicleLightParams])
def test_every_parameter_is_documented(params: type[Params]) -> None:
    text = (ROOT / "docs" / "lights.md").read_text(encoding="utf-8")
    for field in dataclasses.fields(params):
        assert f"`{field.name}`" in text, field.name
        assert field.metadata["host"], field.name


@pytest.mark.parametrize("outer", [5.0, 30.0, 44.0, 46.0, 70.0, 89.0])
def test_balls_hold_all_that_a_spot_lights(outer: float) -> None:
    rng = np.random.default_rng(0)
    light = Light(kind="spot", position=(1, 2, 3), direction=(1, 1, 0), inner_deg=1, outer_deg=outer, r_max_m=20)
    camera = Camera(width=100, height=80, K=K)
    arrays = in_camera([light], camera)
    (ball,) = balls(arrays)
    way = rng.normal(size=(50_000, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    lit = way[way @ arrays.light_direction[0] >= arrays.light_cos_outer[0]]
    reached = arrays.light_position[0] + lit * 20 * rng.uniform(0, 1, (len(lit), 1)) ** 0.2
    assert np.linalg.norm(reached - ball[:3], axis=1).max() <= ball[3] * (1 + 1e-5)
