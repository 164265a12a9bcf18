"""The BRDF: it makes no light, is the same both ways, and keeps its digits."""

from __future__ import annotations

import numpy as np
import pytest

from reference_numpy.brdf import (
    D_GGX,
    DIELECTRIC_F0,
    F_Schlick,
    V_SmithGGXCorrelated,
    alpha_of,
    brdf,
    interface_share,
)
from tests.bench.white_furnace import NOV, furnace

ROUGHNESS = (0.0, 0.045, 0.1, 0.3, 0.5, 0.7, 1.0)
NORMAL = np.array([0.0, 0.0, 1.0])


def directions(count: int, seed: int = 0) -> np.ndarray:
    """Unit vectors over the hemisphere."""
    rng = np.random.default_rng(seed)
    cos, phi = rng.uniform(0.01, 1, count), rng.uniform(0, 2 * np.pi, count)
    sin = np.sqrt(1 - cos**2)
    return np.stack([sin * np.cos(phi), sin * np.sin(phi), cos], axis=-1)


@pytest.mark.parametrize("metallic", [0.0, 0.25, 0.5, 1.0])
@pytest.mark.parametrize("roughness", ROUGHNESS)
def test_no_surface_sends_more_than_it_gets(roughness: float, metallic: float) -> None:
    for NoV in NOV:
        assert furnace("physical", roughness, NoV, metallic=metallic, nodes=200) <= 1 + 1e-3


@pytest.mark.parametrize("roughness", [0.1, 0.3, 0.6])
def test_a_white_metal_seen_head_on_loses_little(roughness: float) -> None:
    # What single scattering loses grows with roughness: 1e-4, 0.009 and 0.17.
    assert 0.8 < furnace("physical", roughness, 1.0, nodes=300) < 1


def test_the_printed_form_makes_light() -> None:
    assert furnace("paper", 0.3, 0.05) == pytest.approx(29.3, rel=0.01)
    assert furnace("paper", 0.3, 1.0) == pytest.approx(0.27, rel=0.03)
    assert furnace("physical", 0.3, 0.05) == pytest.approx(0.9074, abs=1e-3)


def test_the_furnace_is_exact_for_a_diffuser() -> None:
    # A rough dielectric's pigment alone: what is left when a black one is taken away.
    for NoV in (0.3, 0.7, 1.0):
        white, black = (furnace("paper", 1.0, NoV, metallic=0.0, albedo=c) for c in (1.0, 0.0))
        assert white - black == pytest.approx(1.0, abs=1e-4)


def _specular(view: np.ndarray, light: np.ndarray, roughness: float) -> np.ndarray:
    """D V F of the reference: a metal has no other term."""
    return brdf(
        np.broadcast_to(NORMAL, view.shape),
        view,
        light,
        albedo=np.full(view.shape, 0.6),
        roughness=np.full(len(view), roughness),
        metallic=np.ones(len(view)),
        convention="physical",
    )


@pytest.mark.parametrize("roughness", ROUGHNESS)
def test_mirror_term_is_reciprocal(roughness: float) -> None:
    view, light = directions(500, 1), directions(500, 2)
    there, back = _specular(view, light, roughness), _specular(light, view, roughness)
    assert np.allclose(there, back, rtol=1e-12)


@pytest.mark.parametrize("roughness", ROUGHNESS)
def test_microfacets_cover_the_surface_once(roughness: float) -> None:
    # int D NoH dh = 1, over the slope tan(theta) = alpha x, where the lobe has width 1 at any alpha.
    alpha = float(alpha_of(roughness))
    t, w = np.polynomial.legendre.leggauss(200)
    angle = (t + 1) * np.pi / 4  # x = tan(angle)
    theta = np.arctan(alpha * np.tan(angle))
    h = np.stack([np.sin(theta), np.zeros_like(theta), np.cos(theta)], axis=-1)
    dtheta = alpha / np.cos(angle) ** 2 / (1 + (alpha * np.tan(angle)) ** 2)
    integrand = D_GGX(np.broadcast_to(NORMAL, h.shape), h, alpha) * np.cos(theta) * np.sin(theta) * dtheta
    assert 2 * np.pi * np.pi / 4 * (w * integrand).sum() == pytest.approx(1, abs=1e-6)


def test_fresnel_at_its_ends() -> None:
    assert F_Schlick(DIELECTRIC_F0, 1.0) == DIELECTRIC_F0
    assert F_Schlick(DIELECTRIC_F0, 0.0) == 1.0
    cos = np.linspace(0, 1, 50)
    assert (np.diff(F_Schlick(0.3, cos)) < 0).all()


def test_visibility_is_smiths() -> None:
    # V = G / (4 NoV NoL), and G is 1 on a flat surface.
    NoV, NoL = np.array([0.2, 0.7]), np.array([0.9, 0.3])
    assert np.allclose(V_SmithGGXCorrelated(NoV, NoL, 1e-6), 1 / (4 * NoV * NoL), rtol=1e-6)


def test_crossed_product_keeps_the_digits_that_one_minus_the_square_loses() -> None:
    # Near the mirror direction, roughness 0.05, all in float32 against float64.
    alpha = np.float32(alpha_of(0.05))
    rng = np.random.default_rng(3)
    n = directions(2000, 4).astype(np.float32)
    h = n + (rng.normal(size=n.shape) * 3 * alpha).astype(np.float32)
    h = (h / np.linalg.norm(h, axis=-1, keepdims=True)).astype(np.float32)
    exact = np.cross(n.astype(np.float64), h.astype(np.float64))
    exact2, a2 = (exact**2).sum(-1), np.float64(alpha) ** 2
    NoH = (n.astype(np.float64) * h).sum(-1)
    D = a2 / (np.pi * (exact2 + NoH**2 * a2) ** 2)

    def error(across2: np.ndarray) -> float:
        noh = (n * h).sum(-1, dtype=np.float32)
        tried = alpha**2 / (np.float32(np.pi) * (across2 + noh**2 * alpha**2) ** 2)
        return float(np.abs(tried / D - 1).max())

    crossed = np.cross(n, h)
    assert crossed.dtype == np.float32
    assert error((crossed**2).sum(-1, dtype=np.float32)) < 1e-4
    assert error(1 - (n * h).sum(-1, dtype=np.float32) ** 2) > 1e-2


@pytest.mark.parametrize("roughness", [0.045, 0.2, 0.3, 0.5, 0.8, 1.0])
def test_interface_share_is_a_bound(roughness: float) -> None:
    # Black dielectric: what comes back is the interface's share alone.
    for NoV in NOV[1:]:
        assert furnace("physical", roughness, NoV, metallic=0.0, albedo=0.0, nodes=300) <= (
            interface_share(NoV, roughness) + 1e-3
        )


def test_nothing_is_sent_where_the_light_is_behind() -> None:
    view, light = directions(50, 5), -directions(50, 6)
    assert not _specular(view, light, 0.5).any()
