"""Fog: the physics of the reference, and every kernel against it, on plain and on hard inputs."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from aw4d.compare import BAR_MAX, BAR_P9999, error
from aw4d.errors import InputError
from aw4d.lights.light import Light
from aw4d.params import KOSCHMIEDER, FogParams
from reference_numpy.lamp import EPSILON
from tests.fog_inputs import RESULTS, all_kinds, frame, inherent_error, on, reference, street_lamps

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from aw4d.backend_opencl import OpenCLBackend
    from aw4d.gbuffer import GBuffer
    from aw4d.lights.light import LightArrays

GREY = (0.5, 0.55, 0.6)


def params(**changes: Any) -> FogParams:
    return FogParams(**({"color": GREY, "visibility_m": 60.0} | changes))


def test_thin_fog_tends_to_the_source() -> None:
    source = frame()
    out = reference(source, [], params(visibility_m=1e9))
    assert np.abs(out["rgb"] - source["rgb"]).max() < 1e-4
    out = reference(source, all_kinds(), params(visibility_m=None, sigma_s=0.0))
    assert np.array_equal(out["rgb"], source["rgb"])


def test_thick_fog_tends_to_its_colour() -> None:
    out = reference(frame(), [], params(visibility_m=None, sigma_s=10.0))
    assert np.allclose(out["rgb"], GREY, atol=1e-7)


def test_contrast_at_the_visibility_is_two_percent() -> None:
    at_visibility = np.full((4, 4), 60.0, dtype=np.float32)
    sky = np.zeros((4, 4), dtype=bool)
    black, white = (np.full((4, 4, 3), v, dtype=np.float32) for v in (0.0, 1.0))
    low, high = (reference(frame(4, 4, rgb=v, depth=at_visibility, sky=sky), [], params()) for v in (black, white))
    stretch = -np.log(low["transmittance"]) / (KOSCHMIEDER / 60)  # range of each pixel [m]
    assert np.allclose((high["rgb"] - low["rgb"])[..., 0], np.exp(-KOSCHMIEDER * stretch / 60))
    assert np.exp(-KOSCHMIEDER) == pytest.approx(0.02, rel=1e-3)


def test_fog_thickens_with_range() -> None:
    depth = np.tile(np.linspace(1, 200, 64, dtype=np.float32), (2, 1))
    out = reference(frame(64, 2, depth=depth, sky=np.zeros((2, 64), dtype=bool)), [], params())
    assert (np.diff(out["airlight"][:, 20:, 0], axis=1) > 0).all()  # right of the middle, range grows with depth


def test_the_picture_is_the_sum_of_its_layers() -> None:
    source = frame()
    out = reference(source, all_kinds(), params())
    parts = out["transmittance"][..., None] * source["rgb"] + out["in_scatter"] + out["airlight"]
    assert np.allclose(out["rgb"], parts, rtol=1e-12)


def test_absorbing_fog_is_darker_and_as_opaque() -> None:
    clear, sooty = (reference(frame(), [], params(sigma_a=a)) for a in (0.0, 0.03))
    assert np.allclose(clear["transmittance"], sooty["transmittance"])
    assert (sooty["airlight"] < clear["airlight"]).all()


def test_lights_add_up() -> None:
    together = reference(frame(), all_kinds(), params())["in_scatter"]
    alone = sum(reference(frame(), [light], params())["in_scatter"] for light in all_kinds())
    assert np.allclose(together, alone, rtol=1e-12)


def _brute_force(light: Light, ray: np.ndarray, s: float, p: FogParams) -> float:
    """The integral as it is written, by adaptive quadrature over the path."""
    position = np.array(light.position)
    axis = np.array(light.direction) / np.linalg.norm(light.direction)
    cos_inner, cos_outer = np.cos(np.radians([light.inner_deg, light.outer_deg]))

    def integrand(x: float) -> float:
        to_light = position - x * ray
        r2 = to_light @ to_light + EPSILON
        r = np.sqrt(r2)
        mu = ray @ to_light / r
        phase = (1 - p.g**2) / (4 * np.pi * (1 + p.g**2 - 2 * p.g * mu) ** 1.5)
        spot = 1.0
        if light.kind == "spot":
            spot = np.clip((-to_light @ axis / r - cos_outer) / (cos_inner - cos_outer), 0, 1) ** 2
        window = max(1 - (r2 / light.r_max_m**2) ** 2, 0.0) ** 2
        return phase * spot * window / r2 * np.exp(-p.extinction * (x + r))

    # The peak is as narrow as the ray passes near: break the path at distances from it that double.
    steps = 0.01 * 2.0 ** np.arange(14)
    breaks = ray @ position + np.concatenate([-steps[::-1], [0.0], steps])
    edges = np.unique(np.clip(np.concatenate([[0.0], breaks, [s]]), 0, s))
    pieces = [quad(integrand, a, b, limit=200)[0] for a, b in pairwise(edges)]
    return p.sigma_s * light.intensity[0] * sum(pieces)


SPOTS = {
    "point": all_kinds()[1],
    "headlight": all_kinds()[2],
    "headlight of one who comes towards": Light(
        kind="spot", position=(-1.5, 0.3, 14), direction=(0.1, 0.05, -1), inner_deg=10, outer_deg=25, r_max_m=50
    ),
    "across": Light(kind="spot", position=(-4, 0, 8), direction=(1, 0.1, 0.1), inner_deg=15, outer_deg=35, r_max_m=30),
    "lamp": Light(kind="spot", position=(2, -5, 10), direction=(0, 1, 0), inner_deg=15, outer_deg=80, r_max_m=30),
}


@pytest.mark.parametrize("light", SPOTS.values(), ids=list(SPOTS))
def test_in_scatter_is_the_integral_along_the_ray(light: Light) -> None:
    light = replace(light, frame="camera")
    source = frame(13, 11, seed=3, sky=np.zeros((11, 13), dtype=bool))
    p = params(nodes=64)
    found = reference(source, [light], p)["in_scatter"][..., 0]
    rays = source.camera.rays()
    stretch = np.linalg.norm(rays, axis=-1)
    rays, s = rays / stretch[..., None], source["depth"] * stretch
    expected = np.array([[_brute_force(light, rays[v, u], s[v, u], p) for u in range(13)] for v in range(11)])
    # S has a kink at the inner cone, which slows Gauss-Legendre down: 64 nodes leave 2e-4 of the peak.
    assert np.abs(found - expected).max() < 5e-4 * expected.max()


@pytest.mark.parametrize(("nodes", "bound"), [(4, 1e-2), (8, 1e-3), (16, 1e-4), (32, 3e-5)])
def test_more_nodes_converge(nodes: int, bound: float) -> None:
    light = Light(kind="point", position=(1.0, -2.0, 15.0), r_max_m=1e8, frame="camera")
    exact = reference(frame(), [light], params(nodes=64))["in_scatter"]
    found = reference(frame(), [light], params(nodes=nodes))["in_scatter"]
    assert np.abs(found / exact - 1).max() < bound


def test_a_lamp_has_a_halo_and_the_printed_form_has_none() -> None:
    # A lamp 10 m ahead, a wall 40 m away: the integral peaks around the lamp, the constant knows the wall alone.
    wall = np.full((65, 65), 40.0, dtype=np.float32)
    source = frame(65, 65, depth=wall, sky=np.zeros((65, 65), dtype=bool))
    lamp = [Light(kind="point", position=(0.0, 0.0, 10.0), r_max_m=60, frame="camera")]
    halo = reference(source, lamp, params())["in_scatter"][..., 0]
    printed = reference(source, lamp, params(convention="paper"))["in_scatter"][..., 0]
    assert halo[32, 32] > 20 * halo[32, 0]
    assert printed[32, 32] < 4 * printed[32, 0]


def test_no_light_beyond_the_reach_or_outside_the_cone() -> None:
    ahead = Light(kind="spot", position=(0, 0, 5.0), direction=(0, 0, 1), r_max_m=10, frame="camera")
    behind = Light(kind="spot", position=(0, 0, -20.0), direction=(0, 0, -1), r_max_m=10, frame="camera")
    near = np.full((54, 96), 4.0, dtype=np.float32)
    source = frame(depth=near, sky=np.zeros((54, 96), dtype=bool))
    assert not reference(source, [behind], params())["in_scatter"].any()
    straight = reference(source, [ahead], params())["in_scatter"][..., 0]
    assert not straight.any()  # the surfaces stand before the lamp, which shines away from the eye


def test_paper_convention_is_the_printed_formula() -> None:
    source, light = frame(5, 4, seed=2), all_kinds()[1]
    p = params(convention="paper", gamma=0.7)
    assert p.beta == 0.5
    out = reference(source, [light], p)
    points = source.camera.unproject(source["depth"])
    s = np.linalg.norm(points, axis=-1)
    to_light = np.array(light.position) - points
    r2 = np.sum(to_light**2, axis=-1) + EPSILON
    mu = np.sum(points / s[..., None] * to_light, axis=-1) / np.sqrt(r2)
    phase = (1 - 0.64) / (4 * np.pi * (1.64 - 1.6 * mu) ** 1.5)
    window = np.maximum(1 - (r2 / light.r_max_m**2) ** 2, 0) ** 2
    glow = p.sigma_s * phase * 0.7 * window / r2
    T = np.exp(-p.extinction * s)
    f = (1 - T)[..., None]
    observed = source["rgb"] * T[..., None] + glow[..., None] * np.array(light.intensity)
    assert np.allclose(out["rgb"], (1 - 0.5 * f) * observed + 0.5 * f * np.array(GREY), rtol=1e-6)


# ---- kernels against the reference


def check(
    backend: OpenCLBackend, source: GBuffer, lights: Sequence[Light], p: FogParams, *, inherent: Any = None
) -> None:
    """The error bar on the picture and on every layer.

    With `inherent`, the in-scatter may be off by 16 times that much more: at a cone's very edge, where it fades to
    nothing, it is as ill-conditioned as the difference of two cosines.
    """
    truth = reference(source, lights, p)
    for name, found in on(backend, source, lights, p).items():
        assert np.isfinite(found).all(), name
        assert (found >= 0).all(), name
        expected = truth[name]
        if inherent is not None and name == "in_scatter":
            found = expected + np.maximum(np.abs(found - expected) - 16 * inherent[name], 0)
        largest, p9999 = error(found, expected)
        assert largest <= BAR_MAX, f"{name}: {largest:.2e}"
        assert p9999 <= BAR_P9999, f"{name}: {p9999:.2e}"


def check_hard(backend: OpenCLBackend, source: GBuffer, lights: Sequence[Light], p: FogParams) -> None:
    """On hard inputs: 1e-5 everywhere, or 16 x 2^-24 x the condition number that float64 shows, if more."""
    truth = reference(source, lights, p)
    inherent = inherent_error(source, lights, p)
    for name, found in on(backend, source, lights, p).items():
        expected = truth[name]
        assert np.isfinite(expected).all(), name
        assert np.isfinite(found).all(), name
        assert (found >= 0).all(), name
        size = np.abs(expected)
        scale = np.maximum(size, max(1e-3 * float(np.percentile(size, 99)), 1e-30))
        excess = np.abs(found - expected) - np.maximum(1e-5 * scale, 16 * inherent[name])
        assert (excess <= 0).all(), f"{name}: worst {(np.abs(found - expected) / scale).max():.2e}"


@pytest.mark.parametrize("convention", ["physical", "paper"])
@pytest.mark.parametrize("lights", [[], street_lamps(), all_kinds()], ids=["none", "lamps", "kinds"])
def test_kernel_matches_reference(opencl_backend: OpenCLBackend, lights: list[Light], convention: str) -> None:
    source, p = frame(), params(convention=convention)
    check(opencl_backend, source, lights, p, inherent=inherent_error(source, lights, p))


@pytest.mark.parametrize(
    "size", [(1, 1), (1, 9), (9, 1), (13, 7), (15, 3), (16, 3), (17, 3), (31, 2), (32, 2), (33, 2), (129, 5)]
)
def test_every_size(opencl_backend: OpenCLBackend, size: tuple[int, int]) -> None:
    check_hard(opencl_backend, frame(*size, seed=sum(size)), all_kinds(), params())


@pytest.mark.parametrize("g", [0.0, 0.8, -0.8, 0.999, -0.999])
@pytest.mark.parametrize("sigma_s", [0.0, 1e-8, 0.03, 10.0])
def test_density_and_asymmetry(opencl_device: OpenCLBackend, sigma_s: float, g: float) -> None:
    check_hard(opencl_device, frame(), all_kinds(), params(visibility_m=None, sigma_s=sigma_s, g=g))


@pytest.mark.parametrize("depth", [1e-3, 1e5, 60.0])
def test_depth_constant(opencl_device: OpenCLBackend, depth: float) -> None:
    plane = np.full((54, 96), depth, dtype=np.float32)
    check_hard(opencl_device, frame(depth=plane), all_kinds(), params())


def test_depth_spike_and_quantised(opencl_device: OpenCLBackend) -> None:
    steps = np.round(frame()["depth"] / 120 * 255) / 255 * 120
    steps = np.maximum(steps, 1e-3).astype(np.float32)
    steps[30, 40] = 1e4
    check_hard(opencl_device, frame(depth=steps), all_kinds(), params())


@pytest.mark.parametrize("sky", [True, False], ids=["all sky", "no sky"])
def test_masks_full_and_empty(opencl_device: OpenCLBackend, sky: bool) -> None:
    check_hard(opencl_device, frame(sky=np.full((54, 96), sky)), all_kinds(), params())


@pytest.mark.parametrize("radiance", [0.0, 1e5])
def test_radiance(opencl_device: OpenCLBackend, radiance: float) -> None:
    plane = np.full((54, 96, 3), radiance, dtype=np.float32)
    check_hard(opencl_device, frame(rgb=plane), all_kinds(), params())


def _lamp(position: tuple[float, float, float], **changes: Any) -> Light:
    spot = {"kind": "spot", "position": position, "direction": (0.1, 1.0, 0.2), "intensity": (50.0, 50.0, 50.0)}
    return Light(**({"r_max_m": 20.0, "frame": "camera"} | spot | changes))


R = np.float32(20.0)
HARD_LIGHTS = {
    "dark": _lamp((1, -2, 10), intensity=(0, 0, 0)),
    "at the eye": _lamp((0, 0, 0), direction=(0, 0, 1)),
    "a millionth metre from the eye": _lamp((1e-6, 0, 0), direction=(0, 0, 1)),
    "r_max away from the eye": _lamp((0, 0, 20.0), direction=(0, 0, -1)),
    "an ulp inside r_max": _lamp((0, 0, float(np.nextafter(R, np.float32(0)))), direction=(0, 0, -1)),
    "an ulp beyond r_max": _lamp((0, 0, float(np.nextafter(R, np.float32(99)))), direction=(0, 0, -1)),
    "behind the eye, shining ahead": _lamp((0.5, -0.5, -5), direction=(0, 0, 1)),
    "behind the eye, shining back": _lamp((0.5, -0.5, -5), direction=(0, 0, -1)),
    "beyond every surface": _lamp((3, -2, 500.0), direction=(0, 0, -1), r_max_m=600.0),
    "179 degree cone": _lamp((1, -2, 10), inner_deg=60, outer_deg=89.5),
    "needle cone": _lamp((1, -2, 10), inner_deg=0.5, outer_deg=1.0),
    "the eye in its cone": _lamp((0, 0, 12), direction=(0, 0, -1), inner_deg=30, outer_deg=60),
    "axis along the rays": _lamp((0, 0, 3), direction=(0, 0, 1)),
    "across the picture": _lamp((-8, 0, 10), direction=(1, 0, 0)),
    "bare bulb far away": _lamp((-5, -5, 60), kind="point", r_max_m=1e6),
}


@pytest.mark.parametrize("name", HARD_LIGHTS)
def test_hard_lights(opencl_device: OpenCLBackend, name: str) -> None:
    check_hard(opencl_device, frame(97, 55), [HARD_LIGHTS[name]], params())


@pytest.mark.parametrize("miss_m", [0.0, 1e-7, 1e-4, 1e-3])
def test_a_ray_through_the_light(opencl_device: OpenCLBackend, miss_m: float) -> None:
    source = frame(21, 21)
    ray = source.camera.rays()[10, 10]
    position = ray / np.linalg.norm(ray) * 9 + np.array([miss_m, 0, 0])
    light = Light(kind="point", position=tuple(position.tolist()), intensity=(9, 9, 9), r_max_m=30, frame="camera")
    check_hard(opencl_device, source, [light], params())


@pytest.mark.parametrize("sky", [True, False])
@pytest.mark.parametrize("convention", ["physical", "paper"])
def test_sorting_lights_into_tiles_changes_no_pixel_of_the_fog(
    opencl_backend: OpenCLBackend, monkeypatch: pytest.MonkeyPatch, sky: bool, convention: str
) -> None:
    """Lamps before, beside and behind the eye, more than a word of bits has."""
    rng = np.random.default_rng(7)
    places, aims = rng.uniform((-15, -6, -8), (15, 2, 60), (70, 3)).tolist(), rng.normal(size=(70, 3)).tolist()
    cones, reaches = rng.uniform(16, 89, 70).tolist(), rng.uniform(0.5, 15, 70).tolist()
    lights = [
        _lamp(tuple(place), direction=tuple(aim), kind=kind, outer_deg=cone, r_max_m=reach)
        for place, aim, kind, cone, reach in zip(places, aims, ["spot", "point"] * 35, cones, reaches, strict=True)
    ]
    source = frame(120, 70) if sky else frame(120, 70, sky=np.zeros((70, 120), dtype=bool))
    p = params(convention=convention)
    sorted_out = on(opencl_backend, source, lights, p)

    def everything(lights: LightArrays) -> NDArray[np.float32]:
        return np.full((len(lights), 4), [0, 0, 0, np.inf], dtype=np.float32)

    monkeypatch.setattr("aw4d.backend_opencl.balls", everything)
    whole = on(opencl_backend, source, lights, p)
    for name in RESULTS:
        assert np.array_equal(sorted_out[name], whole[name]), name


def test_ten_thousand_lights(opencl_device: OpenCLBackend) -> None:
    rng = np.random.default_rng(5)
    where = rng.uniform((-30, -8, 2), (30, 0, 90), (10_000, 3))
    lights = [_lamp(tuple(p), intensity=(0.1, 0.1, 0.1), r_max_m=6.0) for p in where.tolist()]
    check_hard(opencl_device, frame(17, 9), lights, params(nodes=4))


@pytest.mark.parametrize("origin", [0.0, 5e5, 4e6])
def test_far_from_the_world_origin(opencl_device: OpenCLBackend, origin: float) -> None:
    def at(offset: float) -> dict[str, np.ndarray]:
        pose = np.eye(4)
        pose[:3, 3] = (offset, 20.0, -offset)
        lamp = Light(kind="point", position=(offset + 2, 21.0, 12 - offset), intensity=(20, 20, 20), r_max_m=30)
        return dict(on(opencl_device, frame(pose=pose), [lamp], params()))

    near, far = at(0.0), at(origin)
    for name in RESULTS:
        assert np.array_equal(near[name], far[name]), name


@pytest.mark.parametrize("angles", [(90, 0, 0), (0, 0, 180), (0, 0, 37), (-90, 20, 10)])
def test_turned_camera(opencl_device: OpenCLBackend, angles: tuple[float, float, float]) -> None:
    from scipy.spatial.transform import Rotation

    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
    ahead = pose[:3, 2] * 10 + pose[:3, 0]
    light = Light(kind="spot", position=tuple(ahead.tolist()), direction=(0, -1, 0), intensity=(9, 9, 9))
    check_hard(opencl_device, frame(pose=pose), [light], params())


def test_the_same_frame_twice_is_bit_equal(opencl_backend: OpenCLBackend) -> None:
    first = on(opencl_backend, frame(), all_kinds(), params())
    on(opencl_backend, frame(40, 30, seed=9), [], params())
    again = on(opencl_backend, frame(), all_kinds(), params())
    for name in RESULTS:
        assert np.array_equal(first[name], again[name]), name


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    x=st.floats(-40, 40),
    y=st.floats(-20, 20),
    z=st.floats(-30, 80),
    outer=st.floats(1, 89.9),
    sharp=st.floats(0.05, 0.95),
    reach=st.floats(0.5, 200),
    sigma=st.floats(1e-6, 2),
    g=st.floats(-0.99, 0.99),
)
def test_any_spot_in_any_fog(
    opencl_device: OpenCLBackend,
    x: float,
    y: float,
    z: float,
    outer: float,
    sharp: float,
    reach: float,
    sigma: float,
    g: float,
) -> None:
    light = _lamp((x, y, z), inner_deg=outer * sharp, outer_deg=outer, r_max_m=reach)
    check_hard(opencl_device, frame(23, 11), [light], params(visibility_m=None, sigma_s=sigma, g=g))


def test_a_wide_spot_far_behind_the_eye_in_the_densest_fog(opencl_device: OpenCLBackend) -> None:
    light = _lamp((0.0, 0.0, -7.25), inner_deg=40, outer_deg=80, r_max_m=12)
    check_hard(opencl_device, frame(23, 11), [light], params(visibility_m=None, sigma_s=2.0, g=0.0))


# ---- parameters


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ({"visibility_m": 0.0}, "visibility_m"),
        ({"visibility_m": float("nan")}, "visibility_m"),
        ({"visibility_m": None, "sigma_s": -0.1}, "sigma_s"),
        ({"g": 1.0}, "g"),
        ({"g": -1.0}, "g"),
        ({"beta": 1.5}, "beta"),
        ({"nodes": 7}, "nodes"),
        ({"convention": "literal"}, "convention"),
        ({"color": (0.5, -0.1, 0.5)}, "color"),
        ({"visibility_m": 60.0, "sigma_s": 0.5}, "visibility_m"),
        ({"visibility_m": 1000.0, "sigma_a": 0.5}, "visibility_m"),
    ],
)
def test_impossible_parameters_are_refused(wrong: dict[str, Any], named: str) -> None:
    with pytest.raises(InputError, match=named):
        params(**wrong)


def test_no_fog_at_all_whatever_would_absorb() -> None:
    assert FogParams(alpha=0.0, sigma_a=1.0).extinction == 0


def test_visibility_and_coefficients_describe_the_same_fog() -> None:
    by_visibility = params(visibility_m=100.0)
    by_sigma = params(visibility_m=None, sigma_s=KOSCHMIEDER / 100)
    assert by_visibility.extinction == pytest.approx(by_sigma.extinction)
    assert by_sigma.visibility_m == pytest.approx(100)
    assert params(visibility_m=100.0, alpha=2.0).extinction == pytest.approx(KOSCHMIEDER / 100)


@pytest.mark.parametrize(
    "wrong",
    [
        {"inner_deg": 20.0, "outer_deg": 20.0},
        {"inner_deg": 30.0, "outer_deg": 20.0},
        {"outer_deg": 90.0},
        {"direction": (0.0, 0.0, 0.0)},
        {"intensity": (1.0, -1.0, 1.0)},
        {"position": (float("nan"), 0.0, 0.0)},
        {"r_max_m": 0.0},
    ],
)
def test_impossible_lights_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=r"light|spot"):
        _lamp(**({"position": (0.0, 0.0, 1.0)} | wrong))
