"""Light in the air is left out only where it hardly shows: what is lost stays under the bound that was asked for."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from aw4d.backend_numpy import NumpyBackend
from aw4d.backend_opencl import OpenCLBackend
from aw4d.lights.air_reach import air_reach
from aw4d.lights.light import Light, LightArrays, in_camera
from aw4d.params import FogParams
from aw4d.scene import Scene
from tests.fog_inputs import all_kinds, camera, frame

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


def scattered(lights: LightArrays, p: FogParams) -> NDArray[np.float64]:
    """What the lights scatter into a picture without surfaces, (H, W, 3)."""
    backend = NumpyBackend()
    sky = SOURCE.with_plane("sky", np.ones(SOURCE.camera.shape, dtype=bool))
    planes = backend.upload(sky, Scene(lights=lights), ["in_scatter"])
    backend.run("fog", planes, p)
    return backend.download64(planes, ["in_scatter"])["in_scatter"]


def reach(light: Light, p: FogParams) -> float:
    return float(air_reach(in_camera([light], SOURCE.camera), SOURCE.camera, p)[0])


@settings(max_examples=60, deadline=None)
@given(
    position=st.tuples(*[st.floats(-20, 20)] * 3),
    direction=st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda d: float(np.linalg.norm(d)) > 0.1),
    outer=st.floats(5, 85),
    strength=st.floats(1e-3, 1),
    visibility_m=st.floats(50, 20_000),
)
def test_what_is_left_out_is_fainter_than_asked(
    position: tuple[float, float, float],
    direction: tuple[float, float, float],
    outer: float,
    strength: float,
    visibility_m: float,
) -> None:
    lamp = dataclasses.replace(EGO, position=position, direction=direction, inner_deg=outer / 2, outer_deg=outer)
    whole = in_camera([dataclasses.replace(lamp, intensity=(strength, strength, strength))], SOURCE.camera)
    p = FogParams(visibility_m=visibility_m, color=(0, 0, 0), faintest=5e-4)
    taken = dataclasses.replace(whole, light_air_reach=air_reach(whole, SOURCE.camera, p))
    lost = scattered(whole, p) - scattered(taken, p)
    assert lost.min() >= 0
    assert lost.max() < 1.1 * 5e-4


def test_headlights_show_in_fog_at_dusk_and_not_in_clear_air() -> None:
    assert reach(EGO, FogParams(visibility_m=4_000)) == 0
    assert reach(EGO, FogParams(visibility_m=4_000, faintest=0)) == np.inf
    assert reach(EGO, FogParams(visibility_m=150)) > EGO.r_max_m


def test_a_tail_light_by_day_shows_beside_itself_only() -> None:
    tail = dataclasses.replace(EGO, position=(1.0, 1.0, 20.0), intensity=(0.03, 0.0, 0.0), outer_deg=80, r_max_m=8)
    snowing = FogParams(visibility_m=540)
    assert 0 < reach(tail, snowing) < 0.5
    whole = in_camera([tail], SOURCE.camera)
    far = scattered(dataclasses.replace(whole, light_air_reach=np.float32([reach(tail, snowing)])), snowing)
    assert 0 < np.count_nonzero(far) < 0.05 * np.count_nonzero(scattered(whole, snowing))


def test_a_lamp_in_the_picture_and_the_sun_are_always_taken() -> None:
    clear = FogParams(visibility_m=1e7)
    assert reach(dataclasses.replace(EGO, position=(0.0, 0.0, 20.0)), clear) > 0
    assert reach(Light(kind="directional", frame="camera"), clear) == np.inf


def test_a_lamp_that_is_left_out_sends_nothing() -> None:
    arrays = dataclasses.replace(in_camera([EGO], camera(96, 54)), light_air_reach=np.zeros(1, dtype=np.float32))
    assert scattered(arrays, FogParams(visibility_m=150, color=(0, 0, 0))).max() == 0


@pytest.mark.parametrize("count", [0, 3])
def test_a_reach_a_light(count: int) -> None:
    assert air_reach(in_camera([EGO] * count, SOURCE.camera), SOURCE.camera, FogParams()).shape == (count,)


@pytest.mark.parametrize("reach_m", [0.0, 0.005, 0.4, 3.0, 1e9])
def test_kernel_matches_reference(opencl_backend: OpenCLBackend, reach_m: float) -> None:
    """Below the lamp's own radius of 1 cm nothing is left of it."""
    arrays = in_camera(all_kinds(), SOURCE.camera)
    local = arrays.light_kind > 0
    arrays = dataclasses.replace(arrays, light_air_reach=np.where(local, reach_m, np.inf).astype(np.float32))
    results = []
    for backend in (NumpyBackend(), opencl_backend):
        planes = backend.upload(SOURCE, Scene(lights=arrays), ["in_scatter"])
        backend.run("fog", planes, FogParams(visibility_m=150, color=(0, 0, 0)))
        results.append(backend.download(planes, ["in_scatter"])["in_scatter"].astype(np.float64))
    exact, got = results
    scale = np.maximum(exact, 1e-3 * np.quantile(exact, 0.99))
    assert (np.abs(got - exact) / scale).max() <= 1e-5
