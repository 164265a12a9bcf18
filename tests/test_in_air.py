"""A lamp is left out of the air only where it hardly shows: what is lost stays under the bound that was asked for."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aw4d.backend_numpy import NumpyBackend
from aw4d.lights.in_air import in_air
from aw4d.lights.light import Light, LightArrays, in_camera
from aw4d.params import FogParams
from aw4d.scene import Scene
from tests.fog_inputs import camera, frame

SOURCE = frame(96, 54)
EGO = Light(
    kind="spot",
    position=(0.65, 0.9, 1.6),
    direction=(0.0, 0.017, 1.0),
    intensity=(16.8, 15.6, 13.7),
    inner_deg=10,
    outer_deg=25,
    r_max_m=50,
    frame="camera",
)


def scattered(lights: LightArrays, p: FogParams) -> float:
    """The brightest of what the lights scatter into a picture without surfaces."""
    backend = NumpyBackend()
    sky = SOURCE.with_plane("sky", np.ones(SOURCE.camera.shape, dtype=bool))
    planes = backend.upload(sky, Scene(lights=lights), ["in_scatter"])
    backend.run("fog", planes, p)
    return float(backend.download64(planes, ["in_scatter"])["in_scatter"].max())


def taken(light: Light, p: FogParams) -> bool:
    return bool(in_air(in_camera([light], SOURCE.camera), SOURCE.camera, p)[0])


@settings(max_examples=60, deadline=None)
@given(
    position=st.tuples(*[st.floats(-20, 20)] * 3),
    direction=st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda d: float(np.linalg.norm(d)) > 0.1),
    outer=st.floats(5, 85),
    visibility_m=st.floats(50, 20_000),
)
def test_what_is_left_out_is_fainter_than_asked(
    position: tuple[float, float, float], direction: tuple[float, float, float], outer: float, visibility_m: float
) -> None:
    light = dataclasses.replace(EGO, position=position, direction=direction, inner_deg=outer / 2, outer_deg=outer)
    arrays = in_camera([light], SOURCE.camera)
    p = FogParams(visibility_m=visibility_m, color=(0, 0, 0), faintest=5e-4)
    if not in_air(arrays, SOURCE.camera, p)[0]:
        assert scattered(arrays, p) < 1.1 * 5e-4


def test_headlights_show_in_fog_at_dusk_and_not_in_clear_air() -> None:
    assert not taken(EGO, FogParams(visibility_m=4_000))
    assert taken(EGO, FogParams(visibility_m=4_000, faintest=0))
    assert taken(EGO, FogParams(visibility_m=150))


def test_a_lamp_in_the_picture_and_the_sun_are_always_taken() -> None:
    clear = FogParams(visibility_m=1e7)
    assert taken(dataclasses.replace(EGO, position=(0.0, 0.0, 20.0)), clear)
    assert taken(Light(kind="directional", frame="camera"), clear)


def test_a_lamp_that_is_left_out_sends_nothing() -> None:
    arrays = dataclasses.replace(in_camera([EGO], camera(96, 54)), light_in_air=np.zeros(1, dtype=np.int32))
    assert scattered(arrays, FogParams(visibility_m=150, color=(0, 0, 0))) == 0


@pytest.mark.parametrize("count", [0, 3])
def test_a_flag_a_light(count: int) -> None:
    assert in_air(in_camera([EGO] * count, SOURCE.camera), SOURCE.camera, FogParams()).shape == (count,)
