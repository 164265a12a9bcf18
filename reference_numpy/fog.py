"""Single scattering of lights and daylight in a homogeneous fog. Paper, supplement "Fog modeling", "Fog blending".

The surface fades by `T = exp(-sigma_t s)` along its range s; every light adds the single-scattering integral along the
ray; daylight adds an airlight. Two conventions:

physical
    L_in = int_0^s gamma sigma_s p(cos) I S W / r^2 exp(-sigma_t (x + r)) dx, airlight omega (1 - T) F.
paper
    L_in = gamma sigma_s p(cos) I S W / r^2, a constant taken at the surface, and no airlight but the blend.

Both end in the printed blend `(1 - beta f) L + beta f F` with `f = 1 - T`; under "physical" beta is 0 by default, since
the blend fades the contrast faster than the stated visibility.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from reference_numpy.lamp import DIRECTIONAL, EPSILON, Lamp, lamp
from reference_numpy.phase import henyey_greenstein
from reference_numpy.sampling import gauss_legendre, path_length, rays

Array = NDArray[np.float64]


def fog(
    *,
    rgb: Array,
    depth: Array,
    sky: NDArray[np.bool_],
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    light_kind: NDArray[np.int32],
    light_position: Array,
    light_direction: Array,
    light_intensity: Array,
    light_cos_inner: Array,
    light_cos_outer: Array,
    light_r_max: Array,
    light_air_floor: Array,
    sigma_s: float,
    sigma_a: float,
    alpha: float,
    g: float,
    gamma: float,
    beta: float,
    color: tuple[float, float, float],
    nodes: int,
    extent_m: float,
    convention: str,
) -> dict[str, Array]:
    """Put a frame in fog.

    Parameters
    ----------
    rgb
        (H, W, 3) scene-linear radiance of the surfaces, >= 0.
    depth
        (H, W) z of the surfaces [m], > 0; may be infinite.
    sky
        (H, W) True where the ray meets no surface: its path is `extent_m` ("paper": its depth plane's).
    fx, fy, cx, cy
        Intrinsics [px].
    light_kind
        (L,) 0 directional, 1 point, 2 spot.
    light_position, light_direction
        (L, 3) camera frame [m], and unit, the way the light travels.
    light_intensity
        (L, 3) radiant intensity of points and spots (radiance x m^2), irradiance of directional lights (radiance x sr).
    light_cos_inner, light_cos_outer
        (L,) cosines of a spot's half angles, inner > outer > 0.
    light_r_max
        (L,) reach [m], > 0.
    light_air_floor
        (L,) single scattering of the light at unit intensity towards which it fades to nothing [1/(m sr)], >= 0: inf
        for a light that does not show in the air, 0 for one that is taken whole. Of a point or spot under "physical";
        else inf or not.
    sigma_s, sigma_a
        Scattering and absorption coefficients [1/m], >= 0.
    alpha
        Density factor on both.
    g
        Mean cosine of the phase function, -1 < g < 1.
    gamma
        Strength of the lights' in-scatter; 1 is physical.
    beta
        Strength of the final blend with `color`, 0 to 1.
    color
        Fog colour F, linear: the mean radiance of the surroundings.
    nodes
        Quadrature nodes a light, even.
    extent_m
        Longest path through the fog [m].
    convention
        "physical" or "paper".

    Returns
    -------
    dict
        `rgb` (H, W, 3); `transmittance` (H, W); `in_scatter` and `airlight` (H, W, 3), both as they reach the image.
        With beta = 0: rgb = transmittance * source + in_scatter + airlight.
    """
    paper = convention == "paper"
    scattering, extinction = alpha * sigma_s, alpha * (sigma_s + sigma_a)
    ray, stretch = rays(depth.shape, fx=fx, fy=fy, cx=cx, cy=cy)
    s = path_length(depth, np.zeros_like(sky) if paper else sky, stretch, extent_m=extent_m)
    transmittance = np.exp(-extinction * s)
    opacity = -np.expm1(-extinction * s)

    in_scatter = np.zeros_like(rgb, dtype=np.float64)
    for i in np.flatnonzero(light_air_floor < np.inf).tolist():
        if light_kind[i] == DIRECTIONAL:
            glow = _directional(ray, s, opacity, light_direction[i], extinction=extinction, g=g, paper=paper)
        else:
            source = lamp(
                i,
                light_kind=light_kind,
                light_position=light_position,
                light_direction=light_direction,
                light_cos_inner=light_cos_inner,
                light_cos_outer=light_cos_outer,
                light_r_max=light_r_max,
            )
            if paper:
                glow = _at_surface(source, ray, s, g=g)
            else:
                glow = along_ray(source, ray, s, extinction=extinction, g=g, nodes=nodes)
                glow *= fade(glow, float(light_air_floor[i]))
        in_scatter += gamma * scattering * glow[..., None] * light_intensity[i]

    fog_color = np.asarray(color, dtype=np.float64)
    albedo = 0.0 if paper or extinction == 0 else scattering / extinction
    keep = (1 - beta) + beta * transmittance
    in_scatter *= keep[..., None]
    airlight = (keep * albedo * opacity + beta * opacity)[..., None] * fog_color
    return {
        "rgb": (keep * transmittance)[..., None] * rgb + in_scatter + airlight,
        "transmittance": transmittance,
        "in_scatter": in_scatter,
        "airlight": airlight,
    }


def _directional(
    ray: Array, s: Array, opacity: Array, direction: Array, *, extinction: float, g: float, paper: bool
) -> Array:
    """Phase times the path that scatters, int_0^s exp(-sigma_t x) dx; the paper prints the phase alone."""
    phase = henyey_greenstein(ray @ -np.asarray(direction, dtype=np.float64), g=g)
    if paper:
        return phase
    return phase * (opacity / extinction if extinction > 0 else s)


def fade(glow: Array, floor: float) -> Array:
    """Share of a glow that is kept; 0 at the floor. A fade as short as can be would make much of the glow's error."""
    share: Array = np.maximum(1 - (floor / np.maximum(glow, 1e-30)) ** 2, 0.0) ** 4
    return share


def _at_surface(lamp: Lamp, ray: Array, s: Array, *, g: float) -> Array:
    """The printed in-scatter: phase and attenuated light at the surface, whatever lies between."""
    to_surface = ray * s[..., None] - lamp.position
    r2 = np.einsum("...c,...c->...", to_surface, to_surface) + EPSILON
    r = np.sqrt(r2)
    cos_theta = -np.einsum("...c,...c->...", ray, to_surface) / r
    return henyey_greenstein(cos_theta, g=g) * lamp.cone(to_surface @ lamp.direction / r) * lamp.window(r2) / r2


def along_ray(lamp: Lamp, ray: Array, s: Array, *, extinction: float, g: float, nodes: int) -> Array:
    """Single-scattering integral along each ray, by Gauss-Legendre.

    The substitution x = t0 - D cot(a) makes the 1/r^2 vanish (equiangular, Kulla and Fajardo 2012): dx / r^2 = da / D,
    where a is the scattering angle, D the lamp's distance from the ray (softened by EPSILON), t0 the closest approach.
    What is left of Henyey and Greenstein's peak spreads the nodes: see `_nodes`.
    """
    t0 = ray @ lamp.position
    across = np.cross(lamp.position, ray)
    D = np.sqrt(np.einsum("...c,...c->...", across, across) + EPSILON)
    # Component along the ray, and across it, of the cosine to the spot's axis: cos = -c cos(a) + k sin(a).
    c = ray @ lamp.direction
    k = -(np.cross(ray, across) @ lamp.direction) / D

    reach = np.sqrt(np.maximum(lamp.r_max**2 - D**2, 0.0))
    low = np.arctan2(D, np.minimum(t0, reach))
    high = np.arctan2(D, np.maximum(t0 - s, -reach))
    if lamp.cos_outer >= 0:
        R = np.hypot(c, k)
        middle = np.arctan2(k, -c)
        middle = np.where(middle < -np.pi / 2, middle + 2 * np.pi, middle)  # (0, pi) is reached from above, too
        half = np.arccos(np.clip(lamp.cos_outer / np.maximum(R, lamp.cos_outer), -1.0, 1.0))
        low, high = np.maximum(low, middle - half), np.minimum(high, middle + half)
    lit = (high > low) & (lamp.r_max > D)

    total = np.zeros_like(s)
    low, high, D, t0, c, k = low[lit], high[lit], D[lit], t0[lit], c[lit], k[lit]
    for half_sin, half_cos, weight in _nodes(low, high, g=g, nodes=nodes):
        sin, cos = 2 * half_sin * half_cos, (half_cos - half_sin) * (half_cos + half_sin)
        r = D / sin
        path = t0 + D * half_sin / half_cos  # x + r, the way from the eye to the node and on to the lamp
        light = lamp.cone(k * sin - c * cos) * lamp.window(r * r) * np.exp(-extinction * path)
        total[lit] += weight / D * henyey_greenstein(cos, g=g) * light
    return total


def _nodes(low: Array, high: Array, *, g: float, nodes: int) -> Iterator[tuple[Array, Array, Array]]:
    """Sine and cosine of half the scattering angle at every node from `low` to `high`, and the node's weight [rad].

    1 + g^2 - 2 g cos(a) is the squared length of the vector ((1 - g) cos(a/2), (1 + g) sin(a/2)). The nodes lie on the
    chord between two such vectors of unit length, those of the stretch's ends; the one at h = (cos, sin), of any
    length, weighs da = 2 (low x high) / |h|^2 of the way along the chord. They crowd where the phase function peaks.
    """
    ends = [np.stack([np.cos(a / 2), np.sin(a / 2)]) for a in (low, high)]
    start, end = (h / np.hypot((1 - g) * h[0], (1 + g) * h[1]) for h in ends)
    turn = start[0] * end[1] - start[1] * end[0]
    for x, w in zip(*gauss_legendre(nodes), strict=True):
        h = start + (end - start) * (1 + x) / 2
        length = np.hypot(*h)
        yield h[1] / length, h[0] / length, w * turn / length**2
