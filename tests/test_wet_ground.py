"""Wet surfaces: darker, smoother, only where water gets to; and every kernel against the reference."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from aw4d import street
from aw4d.backend_numpy import NumpyBackend
from aw4d.errors import InputError
from aw4d.gbuffer import GBuffer
from aw4d.params import WetGroundParams
from tests.ground_inputs import SIZES, check, frame, reference, run, unchanged
from tests.lit_inputs import unchecked

if TYPE_CHECKING:
    from aw4d.backend_opencl import OpenCLBackend

SETTINGS = {
    "default": WetGroundParams(),
    "all": WetGroundParams(wetness=1, porosity=1),
    "deep": WetGroundParams(optical_depth=2.0),
    "paper": WetGroundParams(convention="paper"),
    "paper, deep": WetGroundParams(convention="paper", optical_depth=2.0),
}
SIZE = (54, 96)


def up_of(source: GBuffer) -> np.ndarray:
    return source.camera.camera_to_world[1, :3].astype(np.float32)


def of_one_surface(albedo: float, roughness: float, metallic: float = 0.0, turned: float = 1.0) -> GBuffer:
    """A frame of one material whose normal has `turned` of the way up, no sky."""
    source = frame()
    up, ahead = up_of(source), source.camera.camera_to_world[2, :3].astype(np.float32)
    normal = turned * up - np.sqrt(1 - turned**2) * ahead
    return frame(
        albedo=np.full((*SIZE, 3), albedo, np.float32),
        roughness=np.full(SIZE, roughness, np.float32),
        metallic=np.full(SIZE, metallic, np.float32),
        normal=np.broadcast_to(normal.astype(np.float32), (*SIZE, 3)).copy(),
        sky=np.zeros(SIZE, dtype=bool),
        road=np.ones(SIZE, dtype=bool),
    )


def test_wet_asphalt_keeps_half_of_its_albedo() -> None:
    """0.5 to 0.6 of the dry albedo are left of asphalt in heavy rain."""
    wet = reference("wet_ground", of_one_surface(0.12, 0.9), WetGroundParams(wetness=0.7))
    assert 0.5 < wet["albedo"][0, 0, 0] / 0.12 < 0.6


@pytest.mark.parametrize("name", ["default", "all", "deep"])
def test_water_darkens_and_smooths_the_more_the_more_there_is(name: str) -> None:
    source, p = frame(), SETTINGS[name]
    before: dict[str, Any] = dict(source)
    for wetness in (0.0, 0.25, 0.5, 0.75, 1.0):
        now = reference("wet_ground", source, WetGroundParams(wetness=wetness, porosity=p.porosity))
        for plane in ("albedo", "roughness"):
            assert (now[plane] <= before[plane] + 1e-12).all()
            assert (now[plane] >= 0).all()
        before = dict(now)


@pytest.mark.parametrize("name", SETTINGS)
def test_dry_ground_is_as_it_was(opencl_device: OpenCLBackend, name: str) -> None:
    source, p = frame(), WetGroundParams(wetness=0, convention=SETTINGS[name].convention)
    for backend in (NumpyBackend(), opencl_device):
        found = run(backend, "wet_ground", source, p)
        assert unchanged(found, source, ["albedo", "roughness"])
        assert not found["wetness"].any()


@pytest.mark.parametrize(("roughness", "metallic"), [(0.1, 0.0), (0.5, 0.0), (0.9, 1.0)])
def test_paint_glass_and_metal_keep_their_colour(roughness: float, metallic: float) -> None:
    source = of_one_surface(0.3, roughness, metallic)
    assert unchanged(reference("wet_ground", source, WetGroundParams(wetness=1)), source, ["albedo"])


def test_water_neither_roughens_nor_brightens() -> None:
    source = of_one_surface(0.005, 0.95)
    assert (reference("wet_ground", source, WetGroundParams(wetness=1))["albedo"] <= 0.005 + 1e-9).all()
    printed = WetGroundParams(wetness=1, convention="paper")
    assert (reference("wet_ground", source, printed)["albedo"] > 0.015).all()
    mirror = of_one_surface(0.3, 0.02)
    assert unchanged(reference("wet_ground", mirror, WetGroundParams(wetness=1)), mirror, ["roughness"])
    assert np.allclose(reference("wet_ground", mirror, printed)["roughness"], 0.1)


@pytest.mark.parametrize(("turned", "share"), [(1.0, 1.0), (0.0, 0.25), (-1.0, 0.0), (0.5, 0.5625)])
def test_what_lies_open_gets_wettest(turned: float, share: float) -> None:
    wet = reference("wet_ground", of_one_surface(0.2, 0.9, turned=turned), WetGroundParams())["wetness"]
    assert np.allclose(wet, 0.5 * share, atol=1e-6)


def test_snow_keeps_the_ground_dry() -> None:
    source = of_one_surface(0.2, 0.9)
    covered = np.linspace(0, 1, SIZE[0] * SIZE[1]).reshape(SIZE)
    wet = reference("wet_ground", source, WetGroundParams(), snow_bare=1 - covered)
    bare = reference("wet_ground", source, WetGroundParams())
    assert np.allclose(wet["wetness"], bare["wetness"] * (1 - covered), atol=1e-12)
    assert np.array_equal(wet["albedo"][-1, -1], source["albedo"][-1, -1])


def test_the_printed_formula() -> None:
    source = of_one_surface(0.2, 0.9)
    found = reference("wet_ground", source, WetGroundParams(convention="paper"))
    assert np.allclose(found["albedo"], 0.5 * 0.2 + 0.5 * (0.2 * (1 - 0.8) + 0.02 * 0.8))
    assert np.allclose(found["roughness"], 0.9 * 0.5 + 0.1 * 0.5)


def test_no_water_lets_all_through_at_a_grazing_view() -> None:
    """tau = 0, mu = 0: exp(-0 / 0) is 1; and any water lets nothing through."""
    source = frame()
    ray = source.camera.rays()
    grazing = np.stack([ray[..., 2], np.zeros(SIZE), -ray[..., 0]], axis=-1)
    source = frame(normal=(grazing / np.linalg.norm(grazing, axis=-1, keepdims=True)).astype(np.float32))
    for optical_depth, left in ((0.0, 0.02), (1.0, 0.0)):
        p = WetGroundParams(convention="paper", porosity=1, wetness=1, optical_depth=optical_depth)
        assert np.allclose(reference("wet_ground", source, p)["albedo"][source["road"]], left, atol=1e-9)


def test_the_sky_is_no_surface() -> None:
    source = frame()
    for p in SETTINGS.values():
        found = reference("wet_ground", source, p)
        for plane in ("albedo", "roughness"):
            assert np.array_equal(found[plane][source["sky"]], source[plane][source["sky"]])


# ---- kernels against the reference


@pytest.mark.parametrize("name", SETTINGS)
def test_kernel_matches_reference(opencl_backend: OpenCLBackend, name: str) -> None:
    snow = np.random.default_rng(2).random(SIZE, dtype=np.float32)
    check(opencl_backend, "wet_ground", frame(), SETTINGS[name])
    check(opencl_backend, "wet_ground", frame(), SETTINGS[name], snow_bare=snow)


@pytest.mark.parametrize("size", SIZES)
def test_every_size(opencl_backend: OpenCLBackend, size: tuple[int, int]) -> None:
    check(opencl_backend, "wet_ground", frame(*size), SETTINGS["deep"])


@pytest.mark.parametrize("name", SETTINGS)
def test_street(opencl_device: OpenCLBackend, name: str) -> None:
    check(opencl_device, "wet_ground", street.frame(28, width=320, height=176), SETTINGS[name])


@pytest.mark.parametrize("name", SETTINGS)
@pytest.mark.parametrize(
    ("plane", "value"),
    [("normal", 0.0), ("normal", 1.0), ("roughness", 0.0), ("roughness", 1e-3), ("albedo", 1.2), ("albedo", -0.01)],
)
def test_hard_surfaces(opencl_device: OpenCLBackend, name: str, plane: str, value: float) -> None:
    source = frame()
    check(opencl_device, "wet_ground", unchecked(source, **{plane: np.full_like(source[plane], value)}), SETTINGS[name])


@pytest.mark.parametrize("sky", [True, False])
def test_all_sky_and_none(opencl_device: OpenCLBackend, sky: bool) -> None:
    check(opencl_device, "wet_ground", frame(sky=np.full(SIZE, sky)), WetGroundParams())


# ---- parameters


@pytest.mark.parametrize(
    ("wrong", "named"),
    [({"wetness": 1.1}, "wetness"), ({"porosity": -0.1}, "porosity"), ({"convention": "literal"}, "convention")],
)
def test_impossible_parameters_are_refused(wrong: dict[str, Any], named: str) -> None:
    with pytest.raises(InputError, match=named):
        WetGroundParams(**wrong)
