"""Numbers that the paper's formulas give without any data."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from aw4d.reproduce.check import Check, Verdict, compared, follows, same
from aw4d.reproduce.paper import Paper
from reference_numpy.brdf import brdf
from reference_numpy.fbm import fbm
from reference_numpy.night_grade import factors
from reference_numpy.phase import henyey_greenstein
from reference_numpy.puddles import printed_mask
from reference_numpy.snow_cover import coverage

Array = NDArray[np.float64]

METABALLS = "Metaball-based surface snow"
PUDDLES = "Geometry-Anchored Puddle Modeling via World-Space FBM"
VIDREFINER = "VidRefiner Architecture and Configurations"
NIGHT = 1.0  # strength of the night
DARK = 0.01  # an albedo below that of water


def checks(paper: Paper) -> list[Check]:
    """Every line about formulas."""
    return [
        *_poly6(paper),
        _bare_ground(),
        _wet(paper),
        *_puddles(paper),
        *_furnace(),
        *_cones(paper),
        _tone(),
        _phase(paper),
        _far_fog(paper),
        *_start(paper),
    ]


def poly6(r: float, rho: float) -> float:
    """Poly6 as printed [1/m^3]."""
    return 315 / (64 * math.pi * rho**9) * max(rho**2 - r**2, 0) ** 3


def white_furnace(roughness: float, NoV: float, convention: str) -> float:
    """Share of the light around a white metal that it sends to the eye: integral of f_r NoL over the hemisphere.

    Gauss-Legendre in panels over both angles: right to 1e-4 from roughness 0.3 on.
    """
    node, weight = np.polynomial.legendre.leggauss(16)

    def panels(end: float, count: int = 30) -> tuple[Array, Array]:
        half = end / count / 2
        middle = half * (2 * np.arange(count) + 1)
        return (middle[:, None] + half * node).ravel(), np.tile(half * weight, count)

    (theta, d_theta), (phi, d_phi) = panels(math.pi / 2), panels(math.pi)
    sin, cos = np.sin(theta)[:, None], np.cos(theta)[:, None]
    light = np.stack(np.broadcast_arrays(sin * np.cos(phi), sin * np.sin(phi), cos), axis=-1)
    view = np.array([math.sqrt(1 - NoV**2), 0.0, NoV])
    normal = np.array([0.0, 0.0, 1.0])
    white = {"albedo": np.ones(3), "roughness": np.array(roughness), "metallic": np.array(1.0)}
    f_r = brdf(normal, view, light, **white, convention=convention)[..., 0]
    return float(2 * (f_r * cos * sin * d_theta[:, None] * d_phi).sum())


def on_axis(inner: float, outer: float) -> float:
    """The printed angular attenuation in the middle of a cone of these half angles [deg].

    >>> round(on_axis(10, 25), 3)
    1.425
    """
    cos_inner, cos_outer = math.cos(math.radians(inner)), math.cos(math.radians(outer))
    return ((1 - cos_outer) / (cos_inner - cos_outer)) ** 2


def puddle_noise(samples: int = 200_000) -> Array:
    """The printed sum of octaves at places all over a large road."""
    x, z = np.random.default_rng(0).uniform(0, 1e5, (2, samples))
    weight = np.array([0.5, 0.25, 0.125])
    return fbm(x, z, block=np.zeros(3, dtype=np.int64), cells=8, weight=weight, seed=0)


def _poly6(paper: Paper) -> list[Check]:
    rho, rho_0 = paper.number("support radius"), paper.number("base support radius")
    particle = paper.number("radius of a snow particle")
    return [
        compared(
            "support radius, twice a particle's radius [m]",
            METABALLS,
            printed=rho,
            gives=float(2 * particle),
            how=f"2 x {particle} m",
        ),
        compared(
            "support radius that the cascade begins with [m]",
            METABALLS,
            printed=rho,
            gives=float(rho_0),
            how="two radii are given for the same kernel",
        ),
        compared(
            "numerator of Poly6's slope",
            METABALLS,
            printed=paper.count("numerator of Poly6's slope"),
            gives=6 * paper.count("numerator of Poly6") * 32 / 64,
            how="d/dr of (rho^2 - r^2)^3 is -6 r (..)^2; over 32 instead of 64",
        ),
        Check(
            what="height of one metaball at its centre, rho = 0.5 and 0.1 m [m]",
            where=METABALLS,
            printed=None,
            gives=(poly6(0, float(rho_0)), poly6(0, float(rho))),
            verdict=Verdict.UNPHYSICAL,
            how="W(0) = 315 / (64 pi rho^3), a density [1/m^3], added up to heights",
        ),
    ]


def _bare_ground() -> Check:
    covered = float(coverage(np.array(0.0), cover_cm=1.0, gamma=0.9, convention="paper"))
    return Check(
        what="coverage where there is no snow",
        where="Material blending",
        printed=None,
        gives=covered,
        verdict=Verdict.UNPHYSICAL,
        how="sigma(0.8 (0 - 0.03))^0.9; should be 0",
    )


def _wet(paper: Paper) -> Check:
    p, water = float(paper.number("porosity")), float(paper.number("albedo of water"))
    return Check(
        what=f"albedo {DARK} when wet",
        where="Wet ground implementation",
        printed="darker",
        gives=DARK * (1 - p) + water * p,
        verdict=Verdict.CONTRADICTS,
        how=f"A (1 - {p}) + {water} x {p}: whatever is darker than {water} becomes brighter",
    )


def _puddles(paper: Paper) -> list[Check]:
    octaves, persistence = paper.count("octaves"), paper.number("persistence")
    mask = printed_mask(puddle_noise())
    return [
        follows(
            "largest sum of the puddles' noise",
            PUDDLES,
            gives=float(sum(persistence**o for o in range(1, octaves + 1))),
            how="1/2 + 1/4 + 1/8, noise of 0 to 1",
        ),
        follows(
            "share of a large road that is under water",
            PUDDLES,
            gives=float((mask > 0.5).mean()),
            how=f"mask over 0.5; dry, under 0.01: {(mask < 0.01).mean():.2f}; value noise of this project",
        ),
    ]


def _furnace() -> list[Check]:
    return [
        Check(
            what=f"light that a white metal of roughness 0.3 sends to the eye, n.v = {NoV}",
            where="BRDF Modeling",
            printed=None,
            gives=white_furnace(0.3, NoV, "paper"),
            verdict=Verdict.UNPHYSICAL,
            how=f"G is G / (4 NoV NoL) already, and is divided again; once: {white_furnace(0.3, NoV, 'physical'):.3f}",
        )
        for NoV in (0.05, 1.0)
    ]


def _cones(paper: Paper) -> list[Check]:
    return [
        Check(
            what=f"angular attenuation on the axis of a {lamp}",
            where="Light Source Implementation",
            printed=None,
            gives=on_axis(paper.count(f"{lamp}, inner"), paper.count(f"{lamp}, outer")),
            verdict=Verdict.UNPHYSICAL,
            how="no upper clamp before squaring; should be 1",
        )
        for lamp in ("street light", "headlight")
    ]


def _tone() -> Check:
    red, _, blue = factors(NIGHT)
    return Check(
        what="blue over red of the night's table, strength 1",
        where="LUT Construction for Global Tone Mapping",
        printed="warm",
        gives=float(blue / red),
        verdict=same(blue < red),
        how="(1.05 + 0.2) / (0.85 - 0.15): cool, as the text says further down",
    )


def _phase(paper: Paper) -> Check:
    forward, back = henyey_greenstein(np.array([1.0, -1.0]), g=float(paper.number("g of fog")))
    return Check(
        what="fog towards a lamp over fog away from it",
        where="Fog modeling",
        printed="angle between view and light direction",
        gives=float(forward / back),
        verdict=Verdict.UNEXPLAINED,
        how="((1 + g) / (1 - g))^3: which way the light's direction points is not said, and is worth this factor",
    )


def _far_fog(paper: Paper) -> Check:
    beta, opacity, L_obs = float(paper.number("blend of fog")), 1.0, 0.0
    return Check(
        what="share of the fog's colour at infinity, without lamps",
        where="Fog blending",
        printed=None,
        gives=(1 - beta * opacity) * L_obs + beta * opacity,
        verdict=Verdict.UNPHYSICAL,
        how="(1 - beta f) L_obs + beta f F with f = 1 and L_obs = 0; should be 1",
    )


def _start(paper: Paper) -> list[Check]:
    T, alpha = paper.count("steps"), paper.number("editing strength")
    t_s = math.floor((T - 1) * alpha)
    return [
        compared(
            "share of the schedule that is run",
            VIDREFINER,
            printed=alpha,
            gives=(t_s + 1) / T,
            how=f"t_s = floor({T - 1} x {alpha}) = {t_s}, and {t_s} to 0 are {t_s + 1} of {T} steps",
        ),
        follows(
            "index of the first step that is run",
            VIDREFINER,
            gives=T - 1 - t_s,
            how=f"i0 = {T} - 1 - {t_s}, counted from pure noise",
        ),
    ]
