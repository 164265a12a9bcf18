"""Light in the air is left out only where it hardly shows: what is lost stays under the bound that was asked for."""

from __future__ import annotations

import dataclasses
from typing import Literal

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from aw4d.backend_numpy import NumpyBackend
from aw4d.backend_opencl import OpenCLBackend
from aw4d.lights.air_floor import air_floor
from aw4d.lights.light import Light, LightArrays, in_camera
from aw4d.params import FogParams
from aw4d.scene import Scene
from reference_numpy.fog import fade
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


def floor(light: Light, p: FogParams) -> float:
    return float(air_floor(in_camera([light], SOURCE.camera), SOURCE.camera, p)[0])


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
    taken = dataclasses.replace(whole, light_air_floor=air_floor(whole, SOURCE.camera, p))
    lost = scattered(whole, p) - scattered(taken, p)
    assert lost.min() >= 0
    assert lost.max() <= 1.1 * 5e-4


def test_headlights_show_in_fog_at_dusk_and_not_in_clear_air() -> None:
    assert floor(EGO, FogParams(visibility_m=4_000)) == np.inf
    assert floor(EGO, FogParams(visibility_m=4_000, faintest=0)) == 0
    assert floor(EGO, FogParams(visibility_m=150)) < np.inf


def test_fainter_glow_is_taken_in_the_dark() -> None:
    lamp = dataclasses.replace(EGO, position=(0.0, 0.0, 20.0))
    night, dusk, day = (floor(lamp, FogParams(color=(c, c, c))) for c in (0.0, 0.2, 0.6))
    assert 0 < 2 * night < dusk < day


def test_a_tail_light_by_day_shows_beside_itself_only() -> None:
    behind = {"position": (1.0, 1.0, 20.0), "direction": (0.0, 0.0, -1.0)}
    tail = dataclasses.replace(EGO, **behind, intensity=(0.03, 0.0, 0.0), outer_deg=80, r_max_m=8)
    snowing = FogParams(visibility_m=540)
    whole = in_camera([tail], SOURCE.camera)
    far = scattered(dataclasses.replace(whole, light_air_floor=np.float32([floor(tail, snowing)])), snowing)
    assert 0 < np.count_nonzero(far) < 0.05 * np.count_nonzero(scattered(whole, snowing))


def test_a_lamp_in_the_picture_and_the_sun_are_always_taken() -> None:
    clear = FogParams(visibility_m=1e7)
    assert floor(dataclasses.replace(EGO, position=(0.0, 0.0, 20.0)), clear) < np.inf
    assert floor(Light(kind="directional", frame="camera"), clear) == 0


def test_a_lamp_that_is_left_out_sends_nothing() -> None:
    arrays = dataclasses.replace(in_camera([EGO], camera(96, 54)), light_air_floor=np.float32([np.inf]))
    assert scattered(arrays, FogParams(visibility_m=150, color=(0, 0, 0))).max() == 0


@pytest.mark.parametrize("count", [0, 3])
def test_a_floor_a_light(count: int) -> None:
    assert air_floor(in_camera([EGO] * count, SOURCE.camera), SOURCE.camera, FogParams()).shape == (count,)


def both(backend: OpenCLBackend, lights: LightArrays, p: FogParams) -> list[NDArray[np.float64]]:
    """What the lights scatter into the picture, by reference and backend."""
    results = []
    for each in (NumpyBackend(), backend):
        planes = each.upload(SOURCE, Scene(lights=lights), ["in_scatter"])
        each.run("fog", planes, p)
        results.append(each.download(planes, ["in_scatter"])["in_scatter"].astype(np.float64))
    return results


@pytest.mark.parametrize("least", [0.0, 1e-6, 1e-4, 1e-3, 1e-2, np.inf])
def test_kernel_matches_reference(opencl_backend: OpenCLBackend, least: float) -> None:
    arrays = in_camera(all_kinds(), SOURCE.camera)
    local = arrays.light_kind > 0
    arrays = dataclasses.replace(arrays, light_air_floor=np.where(local, least, 0.0).astype(np.float32))
    exact, got = both(opencl_backend, arrays, FogParams(visibility_m=150, color=(0, 0, 0)))
    scale = np.maximum(exact, 1e-3 * np.quantile(exact, 0.99))
    assert (np.abs(got - exact) / scale).max() <= 1e-5


@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    position=st.tuples(st.floats(-15, 15), st.floats(-8, 8), st.floats(-30, 60)),
    direction=st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda d: float(np.linalg.norm(d)) > 0.1),
    outer=st.floats(2, 89),
    kind=st.sampled_from(["spot", "point"]),
    share=st.floats(0.05, 0.99),
    visibility_m=st.floats(10, 2000),
    g=st.floats(-0.95, 0.95),
)
def test_tiles_leave_out_no_more_than_the_floor(
    opencl_device: OpenCLBackend,
    position: tuple[float, float, float],
    direction: tuple[float, float, float],
    outer: float,
    kind: Literal["spot", "point"],
    share: float,
    visibility_m: float,
    g: float,
) -> None:
    """The floor lies among what the lamp's rays gather: what tiles leave out is what the fade makes 0, no more."""
    lamp = dataclasses.replace(
        EGO, kind=kind, position=position, direction=direction, inner_deg=outer / 2, outer_deg=outer
    )
    all_of_it = in_camera([dataclasses.replace(lamp, intensity=(1, 1, 1))], SOURCE.camera)
    p = FogParams(visibility_m=visibility_m, color=(0, 0, 0), g=g)
    scattering = p.alpha * float(p.sigma_s or 0)
    glow = both(opencl_device, all_of_it, p)[1] / scattering
    least = float(np.quantile(glow[glow > 0], share)) if (glow > 0).any() else 1e-3
    faded = both(opencl_device, dataclasses.replace(all_of_it, light_air_floor=np.float32([least])), p)[1] / scattering
    assert np.abs(faded - glow * fade(glow, least)).max() <= 1e-5 * glow.max()
