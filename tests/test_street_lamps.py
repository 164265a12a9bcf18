"""Street lamps from masks: the built-in street's stand where they stand, and what only looks like one is left out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from aw4d import street
from aw4d.clip import Clip, ClipInfo, ClipWriter
from aw4d.gbuffer import GBuffer
from aw4d.lights.street_lamps import lamp_positions, street_lamps
from aw4d.params import StreetLampParams

Array = NDArray[np.float64]
WIDTH, HEIGHT = 640, 352
INDICES = (0, 8, 16, 24)


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Clip:
    """A few frames of the built-in street."""
    cameras = [street.camera(index, width=WIDTH, height=HEIGHT) for index in INDICES]
    info = ClipInfo(
        name="street",
        width=WIDTH,
        height=HEIGHT,
        K=np.array([camera.K for camera in cameras]),
        camera_to_world=np.array([camera.camera_to_world for camera in cameras]),
        times=np.array(INDICES) / street.RATE,
    )
    path = tmp_path_factory.mktemp("lamps") / "street"
    with ClipWriter(path, (len(INDICES), HEIGHT, WIDTH), fingerprint="lamps") as writer:
        for place, index in enumerate(INDICES):
            frame = street.frame(index, width=WIDTH, height=HEIGHT)
            planes = {name: frame[name] for name in ("depth", "sky", "street_light")}
            writer.write(place, GBuffer(planes, camera=frame.camera, time=frame.time))
        return writer.finish(info)


def _heads(clip: Clip) -> Array:
    lights = street_lamps(clip, StreetLampParams(every=1), white_cd_m2=1.0)
    assert [light.name for light in lights] == [f"street-{n + 1}" for n in range(len(lights))]
    return np.array([light.position for light in lights])


def test_no_lamp_is_where_none_stands(clip: Clip) -> None:
    distance = np.linalg.norm(street.lamps()[:, None] - _heads(clip), axis=-1)
    assert distance.min(axis=0).max() < 0.4
    assert (np.count_nonzero(distance < 1, axis=1) <= 1).all(), "a lamp is found once"


def test_lamps_that_are_well_seen(clip: Clip) -> None:
    """Those between 20 and 100 m ahead of the first camera, the nearest of which no tree hides."""
    lamps, eye = street.lamps(), clip.info.camera_to_world[0, :3, 3]
    near = lamps[(lamps[:, 0] - eye[0] > 20) & (lamps[:, 0] - eye[0] < 100)]
    distance = np.linalg.norm(near[:, None] - _heads(clip), axis=-1).min(axis=1)
    assert np.count_nonzero(distance < 0.2) >= len(near) - 1


def test_a_lamp_whose_head_no_frame_shows_is_left_out(clip: Clip) -> None:
    nearest = street.lamps()[street.lamps()[:, 0] > 0][0]  # its post leaves the picture at the upper edge
    assert np.linalg.norm((nearest - _heads(clip))[:, [0, 2]], axis=-1).min() > 5


def test_intensity_is_candela_over_white(clip: Clip) -> None:
    params = StreetLampParams(candela=6000, color=(1, 0.5, 0.25), every=4)
    light = street_lamps(clip, params, white_cd_m2=30)[0]
    assert np.dot(light.intensity, (0.2126, 0.7152, 0.0722)) == pytest.approx(200)
    assert light.intensity[1] == pytest.approx(light.intensity[0] / 2)
    assert (light.kind, light.direction, light.inner_deg, light.outer_deg, light.r_max_m) == (
        "spot",
        (0, -1, 0),
        15,
        35,
        20,
    )


def test_a_clip_without_masks_has_no_lamps(tmp_path: Path) -> None:
    from aw4d.ingest import ingest
    from tests import made_up

    made = ingest(made_up.source(1), tmp_path / "clip")
    assert street_lamps(made, StreetLampParams(), white_cd_m2=1.0) == []


def _lamp(x: float, z: float, rng: np.random.Generator, count: int = 4000) -> Array:
    """Points on a post of 6 m and a head that sticks out by 1 m."""
    post = np.array([x, 0, z]) + rng.uniform((-0.05, 0, -0.05), (0.05, 6, 0.05), (count, 3))
    arm = np.array([x, 6, z]) + rng.uniform((0, -0.05, -0.05), (0.9, 0.05, 0.05), (count // 8, 3))
    head = np.array([x + 1, 6.2, z]) + rng.uniform((-0.3, -0.1, -0.1), (0.3, 0.1, 0.1), (count // 4, 3))
    return np.concatenate([post, arm, head])


def test_the_head_is_the_highest_part() -> None:
    rng = np.random.default_rng(0)
    places = [(0.0, 0.0), (4.0, 4.0), (-30.0, 12.0)]
    heads = lamp_positions(np.concatenate([_lamp(x, z, rng) for x, z in places]))
    np.testing.assert_allclose(heads, [(x + 1, 6.27, z) for x, z in places], atol=0.1)


def test_how_often_a_part_is_seen_does_not_matter() -> None:
    rng = np.random.default_rng(0)
    lamp = _lamp(0, 0, rng)
    foot = lamp[lamp[:, 1] < 2]
    often = np.concatenate([lamp, *([foot] * 50)])
    np.testing.assert_allclose(lamp_positions(often), lamp_positions(lamp), atol=0.02)


def test_specks_are_no_lamps() -> None:
    rng = np.random.default_rng(0)
    specks = np.repeat(rng.uniform(-50, 50, (40, 3)), 100, axis=0)
    assert lamp_positions(specks).shape == (0, 3)
    assert lamp_positions(np.zeros((0, 3))).shape == (0, 3)
