"""Emissive surfaces: lit signals are found, and nothing that only looks like one glows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from aw4d import street
from aw4d.camera import Camera
from aw4d.colour import decode_srgb8, encode_srgb8
from aw4d.errors import InputError
from aw4d.extract.emissive import emissive
from aw4d.io.images import read_rgb
from aw4d.io.source import LEVEL

Image = NDArray[np.float32]
HEIGHT, WIDTH = 240, 400
LENS = (100, 260)  # row and column, above the horizon in row 120
COLOURS = {"red": (1.0, 0.12, 0.08), "amber": (1.0, 0.83, 0.2), "green": (0.2, 1.0, 0.7)}
GREY_SKY, BLUE_SKY = (0.75, 0.75, 0.78), (0.3, 0.45, 0.8)


def _camera() -> Camera:
    K = np.array([[400.0, 0, (WIDTH - 1) / 2], [0, 400, (HEIGHT - 1) / 2], [0, 0, 1]])
    return Camera(width=WIDTH, height=HEIGHT, K=K, camera_to_world=LEVEL)


def _disc(row: float, column: float, radius: float) -> NDArray[np.bool_]:
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    return np.asarray(np.hypot(rows - row, columns - column) < radius)


class _Scene:
    """A grey street under a sky, with all planes; the tests paint into it."""

    def __init__(self, sky: tuple[float, float, float] = GREY_SKY) -> None:
        rng = np.random.default_rng(0)
        self.rgb = rng.uniform(0.1, 0.4, (HEIGHT, WIDTH, 1)).repeat(3, axis=2).astype(np.float32)
        self.sky = np.zeros((HEIGHT, WIDTH), np.bool_)
        self.sky[:50] = True
        self.rgb[self.sky] = sky
        self.road = np.zeros_like(self.sky)
        self.road[170:] = True
        self.vehicle = np.zeros((HEIGHT, WIDTH), np.int32)
        self.depth = np.full((HEIGHT, WIDTH), 20, np.float32)

    def lens(self, colour: tuple[float, float, float], radius: float = 3.0, housing: float | None = 0.02) -> None:
        if housing is not None:
            self.rgb[_disc(*LENS, 2.5 * radius + 2)] = housing
        self.rgb[_disc(*LENS, radius)] = colour

    def car(self, core: float, radius: float = 5.0) -> None:
        self.vehicle[130:190, 150:230] = 3
        self.rgb[130:190, 150:230] = 0.05
        for column in (160, 220):
            self.rgb[_disc(155, column, radius)] = (1.0, 0.2, 0.05)
            self.rgb[_disc(155, column, 0.7 * radius)] = (1.0, core, 0.2)

    def emissive(self) -> Image:
        light = emissive(
            self.rgb, sky=self.sky, road=self.road, vehicle=self.vehicle, depth=self.depth, camera=_camera()
        )
        assert light.dtype == np.float32
        assert ((light == 0) | (light == self.rgb)).all(), "the recorded radiance or none"
        return light


@pytest.mark.parametrize("colour", COLOURS)
@pytest.mark.parametrize("sky", [GREY_SKY, BLUE_SKY])
def test_a_lit_signal(colour: str, sky: tuple[float, float, float]) -> None:
    scene = _Scene(sky)
    scene.lens(COLOURS[colour])
    lens = _disc(*LENS, 3)
    found = scene.emissive().max(axis=-1) > 0
    assert found[lens].all()
    assert not found[~_disc(*LENS, 5)].any()


@pytest.mark.parametrize(
    ("colour", "housing", "radius", "depth"),
    [
        ((0.6, 0.05, 0.03), 0.02, 3.0, 20.0),  # not clipped: a lens that is off
        ((1.0, 0.6, 0.55), 0.02, 3.0, 20.0),  # pale
        ((0.3, 1.0, 1.0), 0.02, 3.0, 20.0),  # sky between leaves
        ((1.0, 0.12, 0.08), None, 3.0, 20.0),  # a red disc on a grey wall
        ((1.0, 0.12, 0.08), 0.9, 3.0, 20.0),  # a red dot on a white sign
        ((1.0, 0.12, 0.08), 0.02, 14.0, 40.0),  # 2.8 m across
        ((1.0, 0.6, 0.2), 0.02, 3.0, 20.0),  # orange in the sun
        ((1.0, 1.0, 1.0), 0.02, 3.0, 20.0),
    ],
)
def test_what_is_no_lit_signal(
    colour: tuple[float, float, float], housing: float | None, radius: float, depth: float
) -> None:
    scene = _Scene()
    scene.depth[:] = depth
    scene.lens(colour, radius, housing)
    assert scene.emissive().max() == 0


@pytest.mark.parametrize("shape", [np.s_[95:105, 250:253], np.s_[99:101, 240:280]])
def test_bars_are_no_lenses(shape: tuple[slice, slice]) -> None:
    scene = _Scene()
    scene.rgb[80:120, 220:300] = 0.02
    scene.rgb[shape] = COLOURS["red"]
    assert scene.emissive().max() == 0


@pytest.mark.parametrize("plane", ["road", "sky", "vehicle"])
def test_road_sky_and_vehicles_have_no_signals(plane: str) -> None:
    scene = _Scene()
    scene.lens(COLOURS["red"])
    assert scene.emissive().max() > 0
    getattr(scene, plane)[80:120] = 1
    assert scene.emissive().max() == 0


def test_a_signal_is_above_the_camera() -> None:
    scene = _Scene()
    scene.rgb[_disc(150, 260, 12)] = 0.02
    scene.rgb[_disc(150, 260, 3)] = COLOURS["red"]
    assert scene.emissive().max() == 0


def test_brake_lights_are_found_under_a_grey_sky() -> None:
    scene = _Scene()
    scene.car(core=0.7)
    found = scene.emissive().max(axis=-1) > 0
    assert found[_disc(155, 160, 4)].all()
    assert found[_disc(155, 220, 4)].all()
    assert not found[scene.vehicle == 0].any()
    assert np.count_nonzero(found) < 1.3 * np.count_nonzero(_disc(155, 160, 5)) * 2


def test_reflectors_that_are_not_lit() -> None:
    scene = _Scene()
    scene.car(core=0.2)
    assert scene.emissive().max() == 0


def test_under_the_sun_no_brake_light_is_taken_for_lit() -> None:
    blue, none, bright = _Scene(BLUE_SKY), _Scene(), _Scene()
    none.sky[:] = False
    bright.rgb[200:] = 1.0
    for scene in (blue, none, bright):
        scene.car(core=0.7)
        assert scene.emissive().max() == 0


def test_a_red_car_does_not_glow() -> None:
    scene = _Scene()
    scene.vehicle[130:190, 150:230] = 3
    scene.rgb[130:190, 150:230] = (1.0, 0.45, 0.1)
    assert scene.emissive().max() == 0


@pytest.mark.parametrize("index", [40, 60])
def test_the_green_lights_of_the_built_in_street(index: int) -> None:
    frame = street.frame(index, width=960, height=528)
    rgb = decode_srgb8(encode_srgb8(frame["rgb"]))
    planes = {name: frame[name] for name in ("sky", "road", "vehicle", "depth")}
    found = emissive(rgb, camera=frame.camera, **planes).max(axis=-1) > 0
    lit = frame["emissive"].max(axis=-1) > 0
    near = lit & (frame["depth"] < 60)
    assert np.count_nonzero(near) >= 8
    assert np.count_nonzero(found & near) >= 0.9 * np.count_nonzero(near)
    rows, columns = np.nonzero(found & ~lit)
    lit_rows, lit_columns = np.nonzero(lit)
    reach = np.hypot(rows[:, None] - lit_rows, columns[:, None] - lit_columns).min(axis=1, initial=np.inf)
    assert reach.max(initial=0) < 2, "beyond the lens only the pixels that it blurs into"


@pytest.mark.clip
def test_nothing_of_a_sunny_drive_glows(kitti_drive: Path) -> None:
    """Red signs, red cars, sunlit tail lights, leaves before the sky: it has no traffic light."""
    from aw4d.extract.sky import sky_mask
    from aw4d.io.kitti import open_kitti

    source = open_kitti(kitti_drive)
    for index in (0, 8, 32, 56):
        rgb, camera = source.rgb(index), source.info.camera(index)
        points = source.points(index)
        sky = sky_mask(rgb, camera=camera, points=None if points is None else points[:, :3])
        none, everything = np.zeros(camera.shape, np.int32), np.ones(camera.shape, np.int32)
        for vehicle in (none, everything):  # whatever the masks are
            for depth in (15.0, 60.0):
                planes = {"sky": sky, "road": np.zeros_like(sky), "vehicle": vehicle}
                distance = np.full(camera.shape, depth, np.float32)
                assert emissive(decode_srgb8(rgb), depth=distance, camera=camera, **planes).max() == 0


# Pictures without a lit coloured lamp that is large enough to be one: snow, sunny streets, roadworks, a tunnel.
DARK = ("caeb782d", "cb22c820", "cb5903ec", "cbd64c44", "cc73b69d", "cc97fab0", "0ace96c3", "8e1c1ab0", "adb4871d")


@pytest.mark.parametrize("name", DARK)
def test_photographs_without_lamps(test_data: Path, name: str) -> None:
    (path,) = (test_data / "bdd100k").glob(f"*_{name}-*.jpg")
    rgb = decode_srgb8(read_rgb(path))
    height, width = rgb.shape[:2]
    K = np.array([[0.95 * width, 0, width / 2], [0, 0.95 * width, height / 2], [0, 0, 1]])
    camera = Camera(width=width, height=height, K=K, camera_to_world=LEVEL)
    none = np.zeros((height, width), np.bool_)
    for depth in (15.0, 30, 80):
        distance = np.full((height, width), depth, np.float32)
        planes = {"sky": none, "road": none, "vehicle": none.astype(np.int32)}
        assert emissive(rgb, depth=distance, camera=camera, **planes).max() == 0


def test_a_plane_of_another_size_is_refused() -> None:
    scene = _Scene()
    scene.sky = scene.sky[:5]
    with pytest.raises(InputError, match="sky: expected a plane"):
        scene.emissive()
