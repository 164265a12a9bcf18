"""Lights of other vehicles: which ones burn, where they are, and how their faces show in the picture."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from aw4d.boxes import Box
from aw4d.clip import ClipInfo
from aw4d.errors import InputError
from aw4d.io.source import LEVEL
from aw4d.lights.light import Light
from aw4d.lights.vehicles import SETBACK, add_vehicle_faces, at_faces, vehicle_lights, vehicle_speeds
from aw4d.params import VehicleLightParams
from reference_numpy.srgb import LUMINANCE

Array = NDArray[np.float64]
PARAMS = VehicleLightParams()
WIDTH, HEIGHT, FOCAL = 320, 160, 300.0
SIZE = (4.4, 1.5, 1.8)


def _box(x: float, z: float, heading: float = 0.0, category: str = "car", track: int = 7) -> Box:
    """On the ground y = 0; heading 0 looks along +z, towards a camera that looks along -z."""
    pose = np.eye(4)
    forward = np.array([np.sin(heading), 0, np.cos(heading)])
    pose[:3, 0], pose[:3, 1], pose[:3, 2] = forward, (0, 1, 0), np.cross(forward, (0, 1, 0))
    pose[:3, 3] = x, SIZE[1] / 2, z
    return Box(track_id=track, category=category, object_to_world=pose, size=SIZE)


def _info(box: Callable[[int], Box | None], frames: int = 9, rate: float = 10.0) -> ClipInfo:
    poses = np.tile(LEVEL, (frames, 1, 1))
    poses[:, 1, 3] = 1.5
    K = np.array([[FOCAL, 0, (WIDTH - 1) / 2], [0, FOCAL, (HEIGHT - 1) / 2], [0, 0, 1]])
    found = [box(index) for index in range(frames)]
    return ClipInfo(
        name="traffic",
        width=WIDTH,
        height=HEIGHT,
        K=np.tile(K, (frames, 1, 1)),
        camera_to_world=poses,
        times=np.arange(frames) / rate,
        boxes=[[] if b is None else [b] for b in found],
    )


def _oncoming(index: int) -> Box:
    return _box(-2.0, -40 + index)


def _ahead(index: int) -> Box:
    return _box(1.0, -20 - index, np.pi)


def _lights(info: ClipInfo, index: int = 4, params: VehicleLightParams = PARAMS) -> dict[str, Light]:
    return {light.name: light for light in vehicle_lights(info, index, params, white_cd_m2=10.0)}


def test_speed_is_that_over_the_ground() -> None:
    speeds = vehicle_speeds(_info(_oncoming))
    assert [frame[7] for frame in speeds] == pytest.approx([10.0] * 9)


def test_the_camera_s_own_motion_does_not_count() -> None:
    info = _info(lambda index: _box(3, -30))
    poses = info.camera_to_world.copy()
    poses[:, 2, 3] = -np.arange(9) * 1.5
    assert max(frame[7] for frame in vehicle_speeds(replace(info, camera_to_world=poses))) < 1e-9


@pytest.mark.parametrize("rate", [10.0, 30.0])
def test_jitter_is_no_motion(rate: float) -> None:
    rng = np.random.default_rng(0)
    jitter = rng.normal(0, 0.1, (60, 2))
    info = _info(lambda index: _box(3 + jitter[index, 0], -30 + jitter[index, 1]), 60, rate)
    assert max(frame[7] for frame in vehicle_speeds(info)) < 1.0
    assert _lights(info) == {}


def test_a_speed_is_known_despite_jitter() -> None:
    rng = np.random.default_rng(0)
    jitter = rng.normal(0, 0.1, (60, 2))
    info = _info(lambda index: _box(jitter[index, 0], -90 + index + jitter[index, 1]), 60)
    assert [frame[7] for frame in vehicle_speeds(info)] == pytest.approx([10.0] * 60, abs=1.0)


def test_frames_that_are_missing_and_tracks_of_one_frame() -> None:
    gaps = vehicle_speeds(_info(lambda index: _oncoming(index) if index % 2 else None))
    assert [sorted(frame) for frame in gaps] == [[7] if index % 2 else [] for index in range(9)]
    assert gaps[5][7] == pytest.approx(10)
    once = _info(lambda index: _oncoming(index) if index == 4 else None)
    assert vehicle_speeds(once)[4] == {7: 0.0}
    assert _lights(once) == {}


def test_an_oncoming_car() -> None:
    lights = _lights(_info(_oncoming))
    assert set(lights) == {f"vehicle-7-{end}-{side}" for end in ("head", "tail") for side in ("left", "right")}
    head, tail = lights["vehicle-7-head-left"], lights["vehicle-7-tail-right"]
    z = -40 + 4.0
    # It comes towards a camera that looks along -z, so that its left is at larger x.
    np.testing.assert_allclose(head.position, (-2 + 0.75 * 0.9, 0.65, z + 2.2), atol=1e-9)
    np.testing.assert_allclose(tail.position, (-2 - 0.75 * 0.9, 0.7, z - 2.2), atol=1e-9)
    dip = np.deg2rad(PARAMS.head_dip_deg)
    np.testing.assert_allclose(head.direction, (0, -np.sin(dip), np.cos(dip)), atol=1e-9)
    np.testing.assert_allclose(tail.direction, (0, 0, -1), atol=1e-9)
    assert np.dot(head.intensity, LUMINANCE) == pytest.approx(2000)
    assert np.dot(tail.intensity, LUMINANCE) == pytest.approx(2)
    assert tail.intensity[1:] == (0, 0)


def test_motion_tells_the_front() -> None:
    """A box that is drawn the wrong way round has its headlights where the vehicle goes."""
    right, wrong = _lights(_info(_oncoming)), _lights(_info(lambda index: _box(-2.0, -40 + index, np.pi)))
    for name, light in right.items():
        np.testing.assert_allclose(wrong[name].position, light.position, atol=1e-9)


def test_a_car_that_waits_keeps_its_lights_on() -> None:
    info = _info(lambda index: _box(-2, -40 + max(0, index - 20)), 40)
    assert vehicle_speeds(info)[0][7] == 0
    assert len(_lights(info, 0)) == 4


@pytest.mark.parametrize(
    ("category", "count"),
    [("Van", 4), ("vehicle.bus.rigid", 4), ("vehicle.motorcycle", 2), ("Pedestrian", 0), ("Cyclist", 0), ("Misc", 0)],
)
def test_kinds_of_vehicles(category: str, count: int) -> None:
    assert len(_lights(_info(lambda index: _box(0, -40 + index, category=category)))) == count


def test_a_clip_without_boxes() -> None:
    info = replace(_info(_oncoming), boxes=[])
    assert vehicle_lights(info, 0, PARAMS, white_cd_m2=1.0) == []
    assert vehicle_speeds(info) == [{}] * 9


def _planes(z: float) -> dict[str, NDArray[np.generic]]:
    """A vehicle all over the picture, at one depth."""
    return {"vehicle": np.ones((HEIGHT, WIDTH), np.int32), "depth": np.full((HEIGHT, WIDTH), z, np.float32)}


def _faces(info: ClipInfo, planes: Mapping[str, NDArray[np.generic]], lit: frozenset[str] | None) -> Array:
    out = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    add_vehicle_faces(out, info, 4, planes, PARAMS, white_cd_m2=10.0, lit=lit)
    assert (out >= 0).all()
    assert np.isfinite(out).all()
    return out.astype(np.float64)


def _emission(info: ClipInfo, z: float, **change: NDArray[np.generic]) -> Array:
    return _faces(info, _planes(z) | change, None)


def test_headlights_show_from_the_front_and_tail_lights_from_behind() -> None:
    oncoming, ahead = _emission(_info(_oncoming), 34.0), _emission(_info(_ahead), 21.8)
    assert oncoming[..., 1].max() > 0
    assert (ahead[..., 0].max() > 0) & (ahead[..., 1:].max() == 0)
    assert 0.9 < ahead.max() / (300 / 0.2126) <= 1
    assert oncoming.sum(axis=-1).astype(bool).sum() <= 2 * 36


@pytest.mark.parametrize("z", [4.0, 10, 30, 60, 90])
def test_the_flux_of_a_face_falls_with_the_square_of_the_distance(z: float) -> None:
    info = _info(lambda index: _box(0, -z - 2.0 - 0.5 * (index - 4), np.pi))
    light = _emission(info, z)[..., 0].sum()
    radius = 0.09 * FOCAL / z
    assert light == pytest.approx(2 * np.pi * radius**2 * 300 / 0.2126, rel=0.03)


def test_a_far_lamp_does_not_flicker_as_it_moves() -> None:
    sums = []
    for shift in np.linspace(0, 1, 11):
        info = _info(lambda index, shift=shift: _box(shift * 0.3, -90 - 0.5 * (index - 4), np.pi))
        sums.append(_emission(info, 88)[..., 0].sum())
    np.testing.assert_allclose(sums, sums[0], rtol=1e-3)


def _tail_at(z: float) -> tuple[ClipInfo, tuple[int, int]]:
    """A car whose tail lights are z away, and the pixel of the brightest."""
    info = _info(lambda index: _box(0, -z - 2.0 - 0.5 * (index - 4), np.pi))
    row, column = np.unravel_index(np.argmax(_emission(info, z)[..., 0]), (HEIGHT, WIDTH))
    return info, (int(row), int(column))


def _red(*windows: tuple[slice, slice]) -> NDArray[np.float32]:
    """Albedo of a grey vehicle with red parts."""
    albedo = np.full((HEIGHT, WIDTH, 3), 0.3, np.float32)
    for window in windows:
        albedo[window] = 0.6, 0.05, 0.02
    return albedo


def test_a_near_tail_light_has_the_place_and_the_flux_of_its_lens() -> None:
    """Here 0.2 m above where the box has it; a red dot, too small for a lens, stands between."""
    z = 4.0
    info, (row, column) = _tail_at(z)
    up, radius = round(0.2 * FOCAL / z), 0.09 * FOCAL / z
    half = round(radius * 1.2)
    lens = slice(row - up - half, row - up + half), slice(column - half, column + half)
    dot = slice(row, row + 1), slice(column, column + 1)
    before, after = _emission(info, z), _emission(info, z, albedo=_red(lens, dot))
    changed = (before != after).any(axis=-1)
    assert after[lens][..., 0].min() == pytest.approx(after[lens][..., 0].max())
    assert after[lens].max() <= before.max()
    assert not after[row, column].any()
    assert after[..., 0].sum() == pytest.approx(before[..., 0].sum(), rel=0.03)
    other = np.zeros((HEIGHT, WIDTH), bool)
    other[:, : column - 2 * half] = other[:, column + 2 * half :] = True
    assert not (changed & other).any(), "the other lamp's side has no lens: its disc stays"


def _lens_above_a_lamp(z: float) -> tuple[ClipInfo, tuple[slice, slice]]:
    """A car whose tail lights are z away, and a lens 0.2 m above where the box has one of them."""
    info, _ = _tail_at(z)
    light = next(light for light in vehicle_lights(info, 4, PARAMS, white_cd_m2=10.0) if "-tail-" in light.name)
    camera = info.camera(4)
    column, row, _ = camera.project(camera.to_camera(np.array(light.position) + np.array([0, 0.2, -SETBACK])))
    half = 0.1 * FOCAL / z
    rows, columns = (slice(round(at - half), round(at + half) + 1) for at in (float(row), float(column)))
    return info, (rows, columns)


def _shown_at(info: ClipInfo, z: float, **change: NDArray[np.generic]) -> tuple[list[Light], Array]:
    """The lights of a car whose lamps are z away, and where the picture has them: (lights, 3) [px, px, m]."""
    lights = vehicle_lights(info, 4, PARAMS, white_cd_m2=10.0)
    found = at_faces(lights, info, 4, _planes(z) | change, PARAMS)
    assert [light.name for light in found] == [light.name for light in lights]
    camera = info.camera(4)
    before, after = (camera.project(camera.to_camera([light.position for light in of])) for of in (lights, found))
    np.testing.assert_allclose(after[:, 2], before[:, 2], rtol=1e-12, err_msg="no light comes nearer")
    return found, after


@pytest.mark.parametrize("x", [-3.0, 0.0, 2.0])
def test_a_lamp_glows_around_its_face(x: float) -> None:
    """From aside: bodies end before their boxes."""
    z = 6.0
    info = _info(lambda index: _box(x, -z - 2.0 - 0.5 * (index - 4), np.pi))
    for light, (column, row, _) in zip(*_shown_at(info, z), strict=True):
        face = _faces(info, _planes(z), frozenset([light.name]))[..., 0]
        if face.any():
            at = np.array([(face * grid).sum() for grid in np.indices(face.shape)]) / face.sum()
            np.testing.assert_allclose(at, [row, column], atol=0.5)


def test_a_near_tail_light_shines_from_its_lens() -> None:
    z = 4.0
    info, lens = _lens_above_a_lamp(z)
    middle = [(part.start + part.stop - 1) / 2 for part in lens]
    _, plain = _shown_at(info, z)
    found, seen = _shown_at(info, z, albedo=_red(lens))
    ((number,),) = np.nonzero((seen != plain).any(axis=-1))
    assert "-tail-" in found[number].name
    np.testing.assert_allclose(seen[number, 1::-1], middle, atol=0.5)


def test_a_light_moves_to_its_lens_without_a_jump() -> None:
    steps = []
    for z in np.arange(4.0, 12.0, 0.25):
        info, lens = _lens_above_a_lamp(z)
        (_, plain), (_, seen) = _shown_at(info, z), _shown_at(info, z, albedo=_red(lens))
        steps.append((plain - seen)[:, 1].max() * z / FOCAL)  # [m] up
    assert steps[0] > 0.15
    assert steps[-1] == 0
    assert np.abs(np.diff(steps)).max() < 0.05


@pytest.mark.parametrize("z", [30.0, 90.0])
def test_a_far_tail_light_is_a_disc_whatever_is_red(z: float) -> None:
    info, (row, column) = _tail_at(z)
    albedo = _red((slice(row - 2, row + 3), slice(column - 2, column + 3)))
    np.testing.assert_array_equal(_emission(info, z, albedo=albedo), _emission(info, z))


def test_a_lens_takes_the_place_of_a_disc_without_a_jump() -> None:
    """A metre nearer at each step, the flux grows as the distance squared falls."""
    flux = []
    for z in np.arange(8.0, 20.0):
        info, (row, column) = _tail_at(z)
        half = round(0.1 * FOCAL / z)
        lens = slice(row - 2 * half, row), slice(column - half, column + half)
        flux.append(_emission(info, z, albedo=_red(lens))[..., 0].sum() * z**2)
    np.testing.assert_allclose(flux, np.mean(flux), rtol=0.1)


def test_what_stands_in_front_hides_a_lamp() -> None:
    info = _info(_ahead)
    assert _emission(info, 10.0).max() == 0
    assert _emission(info, 21.8, vehicle=np.zeros((HEIGHT, WIDTH), np.int32)).max() == 0


def test_behind_the_camera_and_outside_of_the_picture() -> None:
    for x, z in ((0.0, 20.0), (60.0, -20.0), (0.0, -1.0)):
        info = _info(lambda index, x=x, z=z: _box(x, z + 0.5 * (index - 4)))
        assert _emission(info, abs(z)).shape == (HEIGHT, WIDTH, 3)


def test_lamps_can_be_switched_off_one_by_one() -> None:
    info = _info(_ahead)
    both, left = (_faces(info, _planes(21.8), lit)[..., 0] for lit in (None, frozenset({"vehicle-7-tail-left"})))
    assert left.sum() == pytest.approx(both.sum() / 2, rel=1e-3)
    assert np.nonzero(left)[1].mean() < np.nonzero(both)[1].mean()


def test_a_plane_of_another_size_is_refused() -> None:
    with pytest.raises(InputError, match=r"depth: expected a plane of \(160, 320\)"):
        _emission(_info(_ahead), 10.0, depth=np.ones((3, 3), np.float32))
