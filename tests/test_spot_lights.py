"""Local lights: the physics of the reference, and every kernel against it, on plain and on hard inputs."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aw4d import street
from aw4d.compare import BAR_MAX, BAR_P9999, error
from aw4d.gbuffer import GBuffer
from aw4d.lights.ego import headlights
from aw4d.lights.light import Light
from aw4d.params import HeadlightParams, SpotLightsParams
from aw4d.passes import PASSES
from reference_numpy.lamp import EPSILON
from tests.lit_inputs import all_kinds, frame, inherent_error, on, reference, street_lamps, unchecked

if TYPE_CHECKING:
    from collections.abc import Sequence

    from aw4d.backend_opencl import OpenCLBackend

SIZE = (54, 96)


def params(**changes: Any) -> SpotLightsParams:
    return SpotLightsParams(**changes)


def full(*value: float) -> np.ndarray:
    """A plane of one value a channel."""
    return np.full((*SIZE, len(value)) if len(value) > 1 else SIZE, value, dtype=np.float32)


NO_SKY = np.zeros(SIZE, dtype=bool)
WALL = {"normal": full(0, 0, -1), "emissive": full(0, 0, 0), "sky": NO_SKY}  # faces the eye
MATT = {"roughness": full(1), "metallic": full(0), "albedo": full(1, 1, 1)}


def spot(position: tuple[float, float, float], **changes: Any) -> Light:
    given = {"kind": "spot", "position": position, "direction": (0.1, 1.0, 0.2), "intensity": (50.0, 50.0, 50.0)}
    return Light(**({"r_max_m": 20.0, "frame": "camera"} | given | changes))


# ---- physics of the reference


def test_without_lights_only_what_shines_is_seen() -> None:
    source = frame()
    assert np.array_equal(reference(source, [], params()), source["emissive"])


def test_lights_add_up() -> None:
    source = frame(emissive=full(0, 0, 0))
    together = reference(source, all_kinds(), params())
    assert np.allclose(together, sum(reference(source, [light], params()) for light in all_kinds()), rtol=1e-12)


def test_emission_is_added() -> None:
    source = frame()
    dark = frame(emissive=full(0, 0, 0))
    lit = reference(dark, all_kinds(), params())
    assert np.allclose(reference(source, all_kinds(), params()), lit + source["emissive"], rtol=1e-12)


def test_no_light_falls_on_the_sky() -> None:
    source = frame()
    out = reference(source, all_kinds(), params())
    assert np.array_equal(out[source["sky"]], source["emissive"][source["sky"]])
    assert (out != source["emissive"]).any()


def test_light_falls_with_the_square_of_the_distance() -> None:
    source = frame(**WALL, **MATT, depth=full(40))
    point = source.camera.unproject(source["depth"])[27, 48]

    def lit(distance: float) -> float:
        bulb = Light(kind="point", position=tuple(point - [0, 0, distance]), r_max_m=1e5, frame="camera")
        return float(reference(source, [bulb], params())[27, 48, 0])

    assert lit(2) / lit(4) == pytest.approx(4, rel=1e-3)
    assert lit(1) / lit(10) == pytest.approx(100, rel=1e-3)


def test_a_white_diffuser_under_irradiance_pi_shows_as_one() -> None:
    sun = Light(kind="directional", direction=(0, 0, 1), intensity=(np.pi,) * 3, frame="camera")
    out = reference(frame(**WALL, **MATT, depth=full(40)), [sun], params())
    assert out[27, 48, 0] == pytest.approx(1, abs=0.03)  # a rough white dielectric: interface and pigment together


def test_distance_does_not_weaken_a_directional_light() -> None:
    sun = Light(kind="directional", direction=(0, 0, 1), frame="camera")
    near, far = (reference(frame(**WALL, **MATT, depth=full(z)), [sun], params()) for z in (3, 300))
    assert np.allclose(near, far, rtol=1e-12)


def test_cone_is_full_inside_and_dark_outside() -> None:
    # On a wall at 10 m, the lamp at the eye: the angle to the axis is that of the pixel.
    source = frame(**WALL, **MATT, depth=full(10))
    ahead = spot((0, 0, 0), direction=(0, 0, 1), inner_deg=8, outer_deg=16, r_max_m=1e4)
    bulb = replace(ahead, kind="point")
    ray = source.camera.rays()
    angle = np.degrees(np.arccos(1 / np.linalg.norm(ray, axis=-1)))
    share = reference(source, [ahead], params())[..., 0] / reference(source, [bulb], params())[..., 0]
    assert np.allclose(share[angle < 8], 1)
    assert (share[angle > 16] == 0).all()
    between = (angle > 8.1) & (angle < 15.9)
    assert ((share[between] > 0) & (share[between] < 1)).all()


def test_nothing_beyond_the_reach() -> None:
    source = frame(**WALL, **MATT, depth=full(10))
    bulb = Light(kind="point", position=(0, 0, 7), r_max_m=4, frame="camera")
    out = reference(source, [bulb], params())[..., 0]
    away = np.linalg.norm(source.camera.unproject(source["depth"]) - np.array([0, 0, 7]), axis=-1)
    assert (out[away > 4.001] == 0).all()
    assert (out[away < 3.999] > 0).all()


def test_backs_are_dark() -> None:
    behind = Light(kind="point", position=(0, 0, 50), r_max_m=100, frame="camera")
    assert not reference(frame(**WALL, **MATT, depth=full(10)), [behind], params()).any()


def test_a_smoother_surface_has_a_brighter_narrower_highlight() -> None:
    flash = Light(kind="point", position=(0, 0, 0), r_max_m=1e4, frame="camera")
    black = {"albedo": full(0, 0, 0), "metallic": full(0), "depth": full(10)}
    smooth, rough = (
        reference(frame(**WALL, **black, roughness=full(r)), [flash], params())[..., 0] for r in (0.2, 0.6)
    )
    assert smooth[27, 48] > 10 * rough[27, 48]
    assert smooth[27, 5] < rough[27, 5]


def test_metal_reflects_in_its_colour_and_plastic_in_white() -> None:
    flash = Light(kind="point", position=(0, 0, 0), r_max_m=1e4, frame="camera")
    red = {"albedo": full(0.9, 0.1, 0.1), "roughness": full(0.2), "depth": full(10)}
    metal, plastic = (reference(frame(**WALL, **red, metallic=full(m)), [flash], params())[27, 48] for m in (1, 0))
    assert metal[0] / metal[1] == pytest.approx(9, rel=1e-6)
    assert plastic[0] / plastic[1] < 2


def test_paper_convention_is_the_printed_formula() -> None:
    source, light = frame(seed=2), all_kinds()[1]
    found = reference(source, [light], params(convention="paper"))
    depth, sky = source["depth"].astype(np.float64), source["sky"]
    points = source.camera.rays() * depth[..., None]
    n = source["normal"] / np.linalg.norm(source["normal"].astype(np.float64), axis=-1, keepdims=True)
    v = -points / np.linalg.norm(points, axis=-1, keepdims=True)
    p = np.array(light.position) - points
    d2 = (p**2).sum(-1)
    to_light = p / np.sqrt(d2)[..., None]
    h = (to_light + v) / np.linalg.norm(to_light + v, axis=-1, keepdims=True)
    NoV, NoL, NoH = (np.maximum((n * x).sum(-1), 1e-4) for x in (v, to_light, h))
    a2 = np.maximum(source["roughness"].astype(np.float64), 0.045) ** 4
    D = a2 / (np.pi * (NoH**2 * (a2 - 1) + 1) ** 2)
    G = 0.5 / (NoL * np.sqrt(NoV**2 * (1 - a2) + a2) + NoV * np.sqrt(NoL**2 * (1 - a2) + a2))
    metal = source["metallic"][..., None].astype(np.float64)
    f0 = 0.04 * (1 - metal) + source["albedo"] * metal
    F = f0 + (1 - f0) * (1 - (h * v).sum(-1)[..., None]) ** 5
    f_r = source["albedo"] * (1 - metal) / np.pi + (D * G / (4 * NoV * NoL))[..., None] * F
    window = np.maximum(1 - (d2 / light.r_max_m**2) ** 2, 0) ** 2
    expected = source["emissive"] + f_r * (NoL * window / (d2 + EPSILON))[..., None] * np.array(light.intensity)
    plain = ~sky & ((n * to_light).sum(-1) > 1e-3) & ((n * v).sum(-1) > 1e-3)
    assert plain.sum() > 500
    assert np.allclose(found[plain], expected[plain], rtol=1e-4)


# ---- kernels against the reference


def _compared(
    backend: OpenCLBackend, source: GBuffer, lights: Sequence[Light], p: SpotLightsParams
) -> tuple[np.ndarray, np.ndarray]:
    """Reference and result, which must be finite and no negative light."""
    truth, found = reference(source, lights, p), on(backend, source, lights, p)
    assert np.isfinite(truth).all()
    assert np.isfinite(found).all()
    assert (found >= 0).all()
    return truth, found


def check(backend: OpenCLBackend, source: GBuffer, lights: Sequence[Light], p: SpotLightsParams) -> None:
    """The bar of clips: 99.99 % of the values and all of them."""
    truth, found = _compared(backend, source, lights, p)
    largest, p9999 = error(found, truth)
    assert largest <= BAR_MAX, f"{largest:.2e}"
    assert p9999 <= BAR_P9999, f"{p9999:.2e}"


def check_hard(backend: OpenCLBackend, source: GBuffer, lights: Sequence[Light], p: SpotLightsParams) -> None:
    """On hard inputs: 1e-5 everywhere, or 16 x 2^-24 x the condition number that float64 shows, if more."""
    truth, found = _compared(backend, source, lights, p)
    size = np.abs(truth)
    off = np.abs(found - truth) / np.maximum(size, max(1e-3 * float(np.percentile(size, 99)), 1e-30))
    beyond = off > 1e-5
    if beyond.any():
        # The printed form jumps where n.l = 0, by a height that itself varies around there.
        slack = 1.1 if p.convention == "paper" else 1.0
        beyond &= np.abs(found - truth) > slack * inherent_error(source, lights, p)
    assert not beyond.any(), f"{beyond.sum()} values are off by up to {off[beyond].max():.2e}"


@pytest.mark.parametrize("convention", ["physical", "paper"])
@pytest.mark.parametrize("lights", [[], street_lamps(), all_kinds()], ids=["none", "lamps", "kinds"])
def test_kernel_matches_reference(opencl_backend: OpenCLBackend, lights: list[Light], convention: str) -> None:
    check_hard(opencl_backend, frame(), lights, params(convention=convention))


def test_kernel_is_within_the_bar_on_the_street(opencl_backend: OpenCLBackend) -> None:
    seen = street.frame(28, width=320, height=176)
    heads = seen.camera.to_camera(street.lamps())
    lamps = [spot(tuple(p), direction=(0, 1, 0)) for p in heads[heads[:, 2] > 0].tolist()]
    source = GBuffer({name: seen[name] for name in PASSES["spot_lights"].reads}, camera=seen.camera, time=0.0)
    check(opencl_backend, source, lamps + headlights(HeadlightParams(), white_cd_m2=12), params())


@pytest.mark.parametrize(
    "size", [(1, 1), (1, 9), (9, 1), (13, 7), (15, 3), (16, 17), (17, 3), (31, 2), (32, 2), (33, 33), (129, 5)]
)
def test_every_size(opencl_backend: OpenCLBackend, size: tuple[int, int]) -> None:
    check_hard(opencl_backend, frame(*size, seed=sum(size)), all_kinds(), params())


@pytest.mark.parametrize("metallic", [0.0, 1.0])
@pytest.mark.parametrize("roughness", [0.0, 1e-3, 1.0])
def test_roughness_and_metal(opencl_device: OpenCLBackend, roughness: float, metallic: float) -> None:
    source = frame(roughness=full(roughness), metallic=full(metallic))
    for convention in ("physical", "paper"):
        check_hard(opencl_device, source, all_kinds(), params(convention=convention))


@pytest.mark.parametrize("roughness", [0.0, 0.3])
def test_mirrors_towards_the_eye(opencl_device: OpenCLBackend, roughness: float) -> None:
    # Every pixel's normal is the half vector of eye and lamp, off by up to a few alpha.
    source, lamp = frame(), np.array([2.0, -1.0, 12.0])
    points = source.camera.unproject(source["depth"])
    half = _unit(lamp - points) + _unit(-points)
    rng = np.random.default_rng(8)
    normal = _unit(_unit(half) + rng.normal(size=half.shape) * rng.choice([0, 1e-4, 2e-3], (*SIZE, 1)))
    mirrors = frame(normal=normal.astype(np.float32), roughness=full(roughness))
    check_hard(opencl_device, mirrors, [all_kinds()[1]], params())


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector, axis=-1, keepdims=True)


@pytest.mark.parametrize("cosine", [0.0, 1e-7, 1e-3, -1e-7, -0.2])
@pytest.mark.parametrize("towards", ["eye", "light"])
def test_grazing(opencl_device: OpenCLBackend, towards: str, cosine: float) -> None:
    source = frame()
    points = source.camera.unproject(source["depth"])
    axis = _unit((0.0 if towards == "eye" else np.array([2.0, -1.0, 12.0])) - points)
    across = _unit(np.cross(axis, np.random.default_rng(1).normal(size=axis.shape)))
    normal = _unit(across + cosine * axis).astype(np.float32)
    for convention in ("physical", "paper"):
        check_hard(opencl_device, frame(normal=normal), all_kinds(), params(convention=convention))


@pytest.mark.parametrize("lean", [0.0, 1e-3, 1.0])
def test_eye_along_the_light(opencl_device: OpenCLBackend, lean: float) -> None:
    # l = -v: no half vector. Only where the surface is seen from behind, or edge on, can it be lit.
    source = frame()
    ray = _unit(source.camera.unproject(source["depth"]))
    across = _unit(np.cross(ray, [0.3, 0.9, 0.1]))
    normal = _unit(across + lean * ray).astype(np.float32)
    behind = Light(kind="point", position=tuple((ray[30, 40] * 150).tolist()), r_max_m=1e3, frame="camera")
    sun = Light(kind="directional", direction=tuple((-ray[30, 40]).tolist()), frame="camera")
    check_hard(opencl_device, frame(normal=normal), [behind, sun], params())


def test_planes_that_resampling_leaves(opencl_device: OpenCLBackend) -> None:
    rng = np.random.default_rng(4)
    source = frame()
    albedo = rng.uniform(-0.2, 1.2, (*SIZE, 3)).astype(np.float32)
    normal = (source["normal"] * rng.choice([0.0, 0.5, 1.0, 1.4], (*SIZE, 1))).astype(np.float32)
    check_hard(opencl_device, unchecked(source, albedo=albedo, normal=normal), all_kinds(), params())


@pytest.mark.parametrize("radiance", [0.0, 1e5])
def test_emission(opencl_device: OpenCLBackend, radiance: float) -> None:
    check_hard(opencl_device, frame(emissive=full(radiance, radiance, radiance)), all_kinds(), params())


R = np.float32(20.0)
HARD_LIGHTS = {
    "dark": spot((1, -2, 10), intensity=(0, 0, 0)),
    "at the eye": spot((0, 0, 0), direction=(0, 0, 1)),
    "a millionth metre from the eye": spot((1e-6, 0, 0), direction=(0, 0, 1)),
    "r_max away from the eye": spot((0, 0, 20.0), direction=(0, 0, -1)),
    "behind the eye, shining ahead": spot((0.5, -0.5, -5), direction=(0, 0, 1)),
    "behind the eye, shining back": spot((0.5, -0.5, -5), direction=(0, 0, -1)),
    "beyond every surface": spot((3, -2, 500.0), direction=(0, 0, -1), r_max_m=600.0),
    "179 degree cone": spot((1, -2, 10), inner_deg=60, outer_deg=89.5),
    "needle cone": spot((1, -2, 10), inner_deg=0.5, outer_deg=1.0),
    "the eye in its cone": spot((0, 0, 12), direction=(0, 0, -1), inner_deg=30, outer_deg=60),
    "axis along the rays": spot((0, 0, 3), direction=(0, 0, 1)),
    "across the picture": spot((-8, 0, 10), direction=(1, 0, 0)),
    "bare bulb far away": spot((-5, -5, 60), kind="point", r_max_m=1e6),
    "bulb a million metres away": spot((0, 0, -1e6), kind="point", intensity=(1e12, 1e12, 1e12), r_max_m=1e8),
}


@pytest.mark.parametrize("name", HARD_LIGHTS)
def test_hard_lights(opencl_device: OpenCLBackend, name: str) -> None:
    check_hard(opencl_device, frame(97, 55), [HARD_LIGHTS[name]], params())


@pytest.mark.parametrize("away_m", [0.0, 1e-6, 1e-3, 0.1])
def test_a_lamp_on_or_in_a_surface(opencl_device: OpenCLBackend, away_m: float) -> None:
    source = frame(21, 21, depth=np.full((21, 21), 9, dtype=np.float32), sky=np.zeros((21, 21), dtype=bool))
    position = source.camera.unproject(source["depth"])[10, 10] - np.array([0, 0, away_m])
    for kind in ("point", "spot"):
        light = spot(tuple(position.tolist()), kind=kind, direction=(0, 0, 1), inner_deg=30, outer_deg=60)
        check_hard(opencl_device, source, [light], params())


@pytest.mark.parametrize("ulps", [-1, 0, 1])
def test_a_surface_at_the_reach(opencl_device: OpenCLBackend, ulps: int) -> None:
    z = np.float32(30.0)
    for _ in range(abs(ulps)):
        z = np.nextafter(z, np.float32(99 * ulps))
    flat = frame(**(WALL | {"depth": full(float(z))}))
    bulb = Light(kind="point", position=(0, 0, 10), intensity=(9, 9, 9), r_max_m=20, frame="camera")
    check_hard(opencl_device, flat, [bulb], params())


def test_ten_thousand_lights(opencl_device: OpenCLBackend) -> None:
    rng = np.random.default_rng(5)
    where = rng.uniform((-30, -8, 2), (30, 0, 90), (10_000, 3))
    lights = [spot(tuple(p), intensity=(0.1, 0.1, 0.1), r_max_m=6.0) for p in where.tolist()]
    check_hard(opencl_device, frame(37, 19), lights, params())


@pytest.mark.parametrize("depth", [1e-3, 1e5, 60.0])
def test_depth_constant(opencl_device: OpenCLBackend, depth: float) -> None:
    check_hard(opencl_device, frame(depth=full(depth)), all_kinds(), params())


def test_depth_infinite_is_dark(opencl_device: OpenCLBackend) -> None:
    source = frame()
    depth = source["depth"].copy()
    depth[::3, ::5] = np.inf
    loose = unchecked(source, depth=depth)
    check_hard(opencl_device, loose, all_kinds(), params())
    assert np.array_equal(on(opencl_device, loose, all_kinds(), params())[::3, ::5], source["emissive"][::3, ::5])


def test_depth_spike_and_quantised(opencl_device: OpenCLBackend) -> None:
    steps = np.round(frame()["depth"] / 120 * 255) / 255 * 120
    steps = np.maximum(steps, 1e-3).astype(np.float32)
    steps[30, 40] = 1e4
    check_hard(opencl_device, frame(depth=steps), all_kinds(), params())


@pytest.mark.parametrize("sky", [True, False], ids=["all sky", "no sky"])
def test_masks_full_and_empty(opencl_device: OpenCLBackend, sky: bool) -> None:
    check_hard(opencl_device, frame(sky=np.full(SIZE, sky)), all_kinds(), params())


@pytest.mark.parametrize("origin", [5e5, 4e6])
def test_far_from_the_world_origin(opencl_device: OpenCLBackend, origin: float) -> None:
    def at(offset: float) -> np.ndarray:
        pose = np.eye(4)
        pose[:3, 3] = (offset, 20.0, -offset)
        lamp = Light(kind="point", position=(offset + 2, 21.0, 12 - offset), intensity=(20, 20, 20), r_max_m=30)
        return on(opencl_device, frame(pose=pose), [lamp], params())

    assert np.array_equal(at(0.0), at(origin))


def test_the_same_frame_twice_is_bit_equal(opencl_backend: OpenCLBackend) -> None:
    first = on(opencl_backend, frame(), all_kinds(), params())
    on(opencl_backend, frame(40, 30, seed=9), [], params())
    assert np.array_equal(first, on(opencl_backend, frame(), all_kinds(), params()))


@pytest.mark.parametrize("rugged", [True, False], ids=["ragged", "smooth"])
def test_sorting_lights_into_tiles_changes_no_pixel(
    opencl_backend: OpenCLBackend, monkeypatch: pytest.MonkeyPatch, rugged: bool
) -> None:
    rng = np.random.default_rng(7)
    where = rng.uniform((-15, -6, -3), (15, 2, 60), (70, 3))
    aims = rng.normal(size=(70, 3))
    lights = [
        spot(tuple(p), direction=tuple(d), kind=kind, outer_deg=outer, r_max_m=reach)
        for p, d, kind, outer, reach in zip(
            where.tolist(),
            aims.tolist(),
            ["spot", "point"] * 35,
            rng.uniform(16, 89, 70).tolist(),
            rng.uniform(0.5, 15, 70).tolist(),
            strict=True,
        )
    ]
    slope = np.tile(np.linspace(3, 70, 120, dtype=np.float32), (70, 1))
    source = frame(120, 70, **({} if rugged else {"depth": slope}))
    sorted_out = on(opencl_backend, source, lights, params())

    def everything(lights: Any) -> np.ndarray:
        return np.full((len(lights), 4), [0, 0, 0, np.inf], dtype=np.float32)

    monkeypatch.setattr("aw4d.backend_opencl.balls", everything)
    assert np.array_equal(sorted_out, on(opencl_backend, source, lights, params()))


@settings(max_examples=30, deadline=None)
@given(
    x=st.floats(-40, 40),
    y=st.floats(-20, 20),
    z=st.floats(-30, 80),
    outer=st.floats(1, 89.9),
    sharp=st.floats(0.05, 0.95),
    reach=st.floats(0.5, 200),
    roughness=st.floats(0, 1, width=32),
)
def test_any_spot(
    opencl_device: OpenCLBackend,
    x: float,
    y: float,
    z: float,
    outer: float,
    sharp: float,
    reach: float,
    roughness: float,
) -> None:
    light = spot((x, y, z), inner_deg=outer * sharp, outer_deg=outer, r_max_m=reach)
    source = frame(23, 11, roughness=np.full((11, 23), roughness, dtype=np.float32))
    check_hard(opencl_device, source, [light], params())
