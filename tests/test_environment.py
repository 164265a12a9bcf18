"""Environments: their photometry, and their tables against Monte Carlo integrals of the same map."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from aw4d.camera import Camera
from aw4d.environment import Environment, arrays, environment, prefilter
from aw4d.environment.latlong import directions, sample, solid_angles, towards
from aw4d.environment.model import _lobes
from aw4d.errors import InputError
from aw4d.params import AmbientParams
from reference_numpy.brdf import V_SmithGGXCorrelated, alpha_of
from reference_numpy.environment import (
    PARTS,
    Surroundings,
    lobes,
    octahedral,
    octahedral_direction,
    prefiltered,
    reflection,
)
from reference_numpy.srgb import LUMINANCE

Array = NDArray[np.float64]
RECORDED = ("city", "dawn", "night", "sky", "sunset")
PRESETS = ("noon", "golden_hour", "dawn", "blue_hour", "overcast", "midnight")
SIDE = 256  # of the stratified samples, squared


def test_octahedral_map_is_undone() -> None:
    d = np.random.default_rng(0).normal(size=(1000, 3))
    d /= np.linalg.norm(d, axis=-1, keepdims=True)
    np.testing.assert_allclose(octahedral_direction(*octahedral(d)), d, atol=1e-12)


def test_solid_angles_fill_the_sphere_and_towards_points_north_at_azimuth_0() -> None:
    assert (solid_angles(16, 32).sum() * 32) == pytest.approx(4 * np.pi)
    np.testing.assert_allclose(towards(0, 0), (0, 0, -1), atol=1e-12)
    np.testing.assert_allclose(towards(0, 90), (1, 0, 0), atol=1e-12)
    np.testing.assert_allclose(towards(90, 0), (0, 1, 0), atol=1e-12)
    assert directions(8, 16).shape == (8, 16, 3)


@pytest.mark.parametrize(("preset", "lux"), [("noon", 1e5), ("overcast", 1e4), ("blue_hour", 8), ("midnight", 0.5)])
def test_presets_have_their_illuminance(preset: str, lux: float) -> None:
    assert environment(AmbientParams(preset=preset)).illuminance == pytest.approx(lux, rel=1e-6)  # type: ignore[arg-type]


def test_a_given_illuminance_is_met() -> None:
    assert environment(AmbientParams(preset="noon", illuminance_lux=500)).illuminance == pytest.approx(500)


def test_skies_have_their_colours() -> None:
    def above(preset: str) -> Array:
        return environment(AmbientParams(preset=preset)).radiance[:64].mean(axis=(0, 1))  # type: ignore[arg-type]

    blue, noon, overcast = above("blue_hour"), above("noon"), above("overcast")
    assert blue[2] > 1.3 * blue[0]
    assert noon[2] > noon[0]
    assert overcast.max() / overcast.min() < 1.35
    golden = environment(AmbientParams(preset="golden_hour")).sun_irradiance
    assert golden[0] > 1.5 * golden[2]


def test_the_sun_stands_where_it_is_put() -> None:
    around = environment(AmbientParams(preset="noon", sun_altitude_deg=30, sun_azimuth_deg=90))
    np.testing.assert_allclose(around.sun_direction, towards(30, 90), atol=1e-12)
    assert around.sun_irradiance.min() > 0
    low = environment(AmbientParams(preset="noon", sun_altitude_deg=-6))
    assert low.sun_irradiance.max() == 0
    assert low.illuminance < 0.01 * around.illuminance


def test_a_sun_in_an_overcast_sky_is_refused() -> None:
    with pytest.raises(InputError, match="sun_altitude_deg"):
        environment(AmbientParams(preset="overcast", sun_altitude_deg=30))
    with pytest.raises(InputError, match="preset"):
        AmbientParams(preset="evening")  # type: ignore[arg-type]


@pytest.fixture(scope="module", params=[*PRESETS, "city.hdr", "sunset.hdr", "night.hdr"])
def around(request: pytest.FixtureRequest) -> Environment:
    """Every preset, and recorded maps."""
    if str(request.param).endswith(".hdr"):
        folder: Path = request.getfixturevalue("test_data")
        return environment(AmbientParams(map=str(folder / "hdri_cc0" / request.param)))
    return environment(AmbientParams(preset=request.param))


def tables(around: Environment) -> dict[str, Array]:
    """Its tables for a camera that does not turn, float64."""
    camera = Camera(width=8, height=8, K=np.array([[8.0, 0, 4], [0, 8, 4], [0, 0, 1]]))
    return {name: np.asarray(value, dtype=np.float64) for name, value in vars(arrays(around, camera, 1.0)).items()}


def surroundings(around: Environment) -> Surroundings:
    """The same as the passes look it up."""
    t = tables(around)
    return Surroundings(specular=t["env_specular"], zonal=t["env_zonal"], colour=t["env_colour"])


def test_surroundings_that_are_alike_all_around_go_by_elevation(around: Environment) -> None:
    """Those of snow, rain and fog; no others here."""
    luminance = around.radiance @ LUMINANCE
    alike = np.ptp(luminance, axis=1).max() <= 1e-6 * luminance.max()
    colours = around.radiance[luminance > 0] / luminance[luminance > 0][:, None]
    assert bool(tables(around)["env_zonal"].size) == (alike and np.ptp(colours, axis=0).max() <= 1e-6)


def test_both_kinds_of_tables_tell_the_same_light() -> None:
    """Where lobes are wider than texels."""
    given, rng = surroundings(environment(AmbientParams(preset="overcast"))), np.random.default_rng(3)
    d, roughness = rng.normal(size=(4096, 3)), rng.uniform(0.3, 1.0, 4096)
    np.testing.assert_allclose(given.prefiltered(d, roughness), prefiltered(given.specular, d, roughness), rtol=5e-3)


def strata(rng: np.random.Generator) -> tuple[Array, Array]:
    """Stratified pairs of numbers in [0, 1)."""
    u, v = np.meshgrid(np.arange(SIDE), np.arange(SIDE))
    return ((u + rng.random(u.shape)) / SIDE).ravel(), ((v + rng.random(v.shape)) / SIDE).ravel()


def basis(n: Array) -> Array:
    """Rows: two vectors across n, and n."""
    t = np.cross(n, (1.0, 0, 0) if abs(n[0]) < 0.7 else (0, 1.0, 0))
    t /= np.linalg.norm(t)
    return np.stack([t, np.cross(n, t), n])


def test_irradiance_is_the_monte_carlo_integral_within_a_percent(around: Environment) -> None:
    """The noise of the estimate, by eight independent ones, is under 0.3 %, and allowed for."""
    given, table, rng = surroundings(around), tables(around)["env_irradiance"], np.random.default_rng(1)
    for n in ((0, 1.0, 0), (1.0, 0, 0), (0, 0, -1.0), (0.6, 0.64, 0.48), (-0.48, -0.6, 0.64)):
        estimates = []
        for _ in range(8):
            u, v = strata(rng)
            r, phi = np.sqrt(u), 2 * np.pi * v
            local = np.stack([r * np.cos(phi), r * np.sin(phi), np.sqrt(1 - u)], axis=-1)
            estimates.append(np.pi * sample(around.radiance, local @ basis(np.array(n))).mean(axis=0) @ LUMINANCE)
        mean, noise = np.mean(estimates), np.std(estimates) / np.sqrt(8)
        assert noise < 0.003 * mean
        assert abs(given.irradiance_on(np.array(n), table) @ LUMINANCE - mean) <= 0.01 * mean + 3 * noise


def microfacets(view: Array, alpha: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Directions to the light by GGX' visible normals (Heitz 2018), local frame, and the weight G2 / G1 of each."""
    stretched = np.array([alpha * view[0], alpha * view[1], view[2]])
    stretched /= np.linalg.norm(stretched)
    t1 = np.array([0.0, 1, 0]) if stretched[2] > 0.9999 else np.cross((0, 0, 1.0), stretched)
    t1 /= np.linalg.norm(t1)
    t2 = np.cross(stretched, t1)
    u, v = strata(rng)
    r, phi = np.sqrt(u), 2 * np.pi * v
    a, b = r * np.cos(phi), r * np.sin(phi)
    s = 0.5 * (1 + stretched[2])
    b = (1 - s) * np.sqrt(np.maximum(1 - a**2, 0)) + s * b
    h = a[:, None] * t1 + b[:, None] * t2 + np.sqrt(np.maximum(1 - a**2 - b**2, 0))[:, None] * stretched
    h = np.stack([alpha * h[:, 0], alpha * h[:, 1], np.maximum(h[:, 2], 1e-9)], axis=-1)
    h /= np.linalg.norm(h, axis=-1, keepdims=True)
    to_light = 2 * (h @ view)[:, None] * h - view
    NoL, NoV = np.maximum(to_light[:, 2], 1e-9), view[2]
    G1 = 2 * NoV / (NoV + np.sqrt(NoV**2 * (1 - alpha**2) + alpha**2))
    G2 = 4 * NoL * NoV * V_SmithGGXCorrelated(NoV, NoL, alpha)
    return to_light, np.where(to_light[:, 2] > 0, G2 / G1, 0.0)


def ratios_to_monte_carlo(around: Environment, NoV: float, roughness: float) -> Array:
    """Light of a mirror of F0 = 1 over its integral: of a level floor and of a wall, each seen in four ways."""
    t, rng = tables(around), np.random.default_rng(2)
    found = lobes(t["env_brdf"], np.array([NoV]), np.array([roughness]))
    side, ratios = np.sqrt(1 - NoV**2), []
    for n, turn in product((np.array([0, 1.0, 0]), np.array([0.6, 0, 0.8])), (0.3, 1.9, 3.4, 5.2)):
        frame, view = basis(n), np.array([side * np.cos(turn), side * np.sin(turn), NoV])
        to_light, weight = microfacets(view, float(alpha_of(roughness)), rng)
        truth = (sample(around.radiance, to_light @ frame) * weight[:, None]).mean(axis=0) @ LUMINANCE
        mirror = (2 * NoV * n - view @ frame)[None]
        light = sum(reflection(surroundings(around), found[:, part], mirror, n) for part in PARTS)
        ratios.append(float(light[0] @ LUMINANCE) / truth)
    return np.array(ratios)


@pytest.mark.parametrize("roughness", [0.15, 0.4, 0.7])
@pytest.mark.parametrize("NoV", [0.3, 0.6, 0.95])
@pytest.mark.parametrize("preset", PRESETS)
def test_specular_is_the_monte_carlo_integral(preset: str, NoV: float, roughness: float) -> None:
    """Within 5 % in the mean of eight ways to look, within 15 % in each."""
    ratios = ratios_to_monte_carlo(environment(AmbientParams(preset=preset)), NoV, roughness)  # type: ignore[arg-type]
    assert np.mean(ratios) == pytest.approx(1, abs=0.05)
    assert ratios == pytest.approx(1, abs=0.15)


# Of a glow on the horizon that a dark ground borders, what round lobes lose below the horizon is too much.
GLOW = [("dawn", 0.3, 0.7), ("dawn", 0.6, 0.7)]


@pytest.mark.parametrize(
    ("name", "NoV", "roughness"),
    [
        pytest.param(*case, marks=pytest.mark.xfail(reason="-6 %, docs/ambient.md", strict=True))
        if case in GLOW
        else case
        for case in product(RECORDED, (0.3, 0.6, 0.95), (0.15, 0.4, 0.7))
    ],
)
def test_specular_of_recorded_maps(test_data: Path, name: str, NoV: float, roughness: float) -> None:
    """Within 5 % in the mean of eight ways to look; a lamp beside the mirror direction is off by up to a quarter."""
    around = environment(AmbientParams(map=str(test_data / "hdri_cc0" / f"{name}.hdr")))
    ratios = ratios_to_monte_carlo(around, NoV, roughness)
    assert np.mean(ratios) == pytest.approx(1, abs=0.05)
    assert ratios == pytest.approx(1, abs=0.25)


def test_a_white_mirror_in_white_surroundings_loses_only_what_is_reflected_twice() -> None:
    rough, NoV = (a.ravel() for a in np.meshgrid(np.linspace(0.05, 1, 20), np.linspace(0.05, 1, 20)))
    share = lobes(tables(environment(AmbientParams()))["env_brdf"], NoV, rough)[..., 0].sum(axis=-1)
    assert (share <= 1 + 1e-3).all()
    assert (share > 0.3).all()


def test_the_table_of_lobes_in_the_package_is_what_is_made() -> None:
    # Where it must change: np.save("aw4d/environment/lobes.npy", lobe_table().astype(np.float32))
    np.testing.assert_allclose(_lobes(), prefilter.lobe_table(), rtol=0, atol=1e-6)
