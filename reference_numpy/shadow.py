"""Shadows of the sun, marched through the depth of what the picture shows.

A ray leaves the surface at (X0, Y0, Z0) towards the sun L. At t metres along it, with tau = t / Z and Z = Z0 + t Lz, it
is seen at the pixel

    u = u0 + tau (fx Lx - (u0 - cx) Lz),   v = v0 + tau (fy Ly - (v0 - cy) Lz),   Z0 / Z = 1 - tau Lz,

all linear in tau. So equal steps of tau are equal steps in the picture, the same ones for every pixel. At each step
the four nearest pixels are asked whether they stand before the ray, and their answers, not their depths, are
interpolated: no surface appears between two that are apart. The ray's own depth is carried over to each of the four
along the plane of the surface that it left, so that a plane never shades itself, at whatever slant it is seen.

Every decision is a ramp, none a comparison: the result is a continuous function of its inputs and does not flicker.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STEP = 3 / 256  # of tau between samples: of the focal length in the picture, where the sun stands at the side
BIAS = 0.002  # [1] of the depth, that a surface must be before the ray to count
SOFT = 0.01  # [1] of the depth, over which it comes to count in full, and, beyond the fade, ends
FADE = 0.25  # [1] of thickness and distance, over which they end
CLEAR = 0.02  # NoL below which a surface turns away and shadows fade: there they would be drawn by rounding
JOINED = 0.01  # [1] of the depth, between neighbouring pixels: up to it they are one surface, from twice as much on two
SLANTED = 4.0  # [1] of the thickness, by which it grows at most where a surface is seen at a slant
NOTHING = 1e6  # [m] depth of the sky
MAX_SLANT = 50.0  # [1] steepest plane, in depth over width
CORNERS = ((0, 0), (1, 0), (0, 1), (1, 1))


def sun_shadow(
    *,
    depth: Array,
    sky: NDArray[np.bool_],
    normal: Array,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    sun_direction: Array,
    shadow_steps: int,
    shadow_distance_m: float,
    thickness_m: float,
) -> Array:
    """Share of the sun's light that arrives, (H, W), 0 to 1; 1 in the sky and where a surface faces away from the sun.

    Parameters
    ----------
    depth, sky, normal
        (H, W) [m], (H, W), and (H, W, 3) unit, camera frame.
    fx, fy, cx, cy
        Intrinsics [px].
    sun_direction
        (3,) unit, towards the sun, camera frame.
    shadow_steps, shadow_distance_m, thickness_m
        Samples a ray; how far a shadow is cast [m]; how far behind what is seen things reach [m].
    """
    height, width = depth.shape
    L = np.asarray(sun_direction, dtype=np.float64)
    solid = np.where(sky, NOTHING, depth)
    v, u = (i.astype(np.float64) for i in np.nonzero(~sky))
    ray = _Ray(depth[~sky], normal[~sky], (u - cx) / fx, (v - cy) / fy, fx, fy, L)
    hidden = np.zeros_like(u)
    alive = np.flatnonzero(ray.NoL > 0)
    for k in range(1, shadow_steps + 1):
        tau = k * STEP
        c = 1 - tau * L[2]
        if c <= 0:
            break
        U, V = u[alive] + tau * ray.a[alive], v[alive] + tau * ray.b[alive]
        t = tau * ray.Z0[alive] / c
        inside = (U > -1) & (width > U) & (V > -1) & (height > V)
        on = inside & (t < shadow_distance_m) & (hidden[alive] < 1)
        alive, U, V, t = alive[on], U[on], V[on], t[on]
        if not alive.size:
            break
        blocked = _blocked(solid, ray, alive, U, V, c, thickness_m)
        blocked *= _ramp((shadow_distance_m - t) / (FADE * shadow_distance_m))
        hidden[alive] = np.maximum(hidden[alive], blocked)
    lit = np.ones(depth.shape)
    lit[~sky] = 1 - _smooth(hidden) * _smooth(_ramp(ray.NoL / CLEAR))
    return lit


class _Ray:
    """Rays from surfaces to the sun, (N,) each: their way in the picture, and the plane that each one leaves."""

    def __init__(self, Z0: Array, n: Array, kx: Array, ky: Array, fx: float, fy: float, L: Array) -> None:
        self.Z0 = Z0
        self.NoL = n @ L
        self.a, self.b = fx * (L[0] - kx * L[2]), fy * (L[1] - ky * L[2])  # [px] for tau = 1
        slant = n[:, 0] * kx + n[:, 1] * ky + n[:, 2]
        slant = np.minimum(slant, -np.hypot(n[:, 0], n[:, 1]) / MAX_SLANT - 1e-6)
        self.gu, self.gv = n[:, 0] / (fx * slant), n[:, 1] / (fy * slant)  # of Z0 / Z along the plane [1/px]


def _blocked(
    solid: Array, ray: _Ray, alive: NDArray[np.int64], U: Array, V: Array, c: float, thickness: float
) -> Array:
    """Share of the four pixels around (U, V) that stand before the ray, which is at depth Z0 / c there."""
    height, width = solid.shape
    Z0, gu, gv = ray.Z0[alive], ray.gu[alive], ray.gv[alive]
    u1, v1 = np.floor(U), np.floor(V)
    wu, wv = U - u1, V - v1
    z = {}
    for du, dv in CORNERS:
        x, y = (u1 + du).astype(int), (v1 + dv).astype(int)
        inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
        z[du, dv] = np.where(inside, solid[np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)], NOTHING)
    slanted = _slanted(z, ray.a[alive], ray.b[alive], SLANTED * thickness)
    fade = FADE * thickness + SOFT * Z0 + slanted / 2
    far = thickness + slanted + fade
    total = np.zeros_like(U)
    for du, dv in CORNERS:
        here = c + gu * (du - wu) + gv * (dv - wv)
        behind = (Z0 - z[du, dv] * here) / c  # [m] of the ray behind what is seen
        full = _ramp((behind / Z0 - BIAS) / SOFT) * _ramp((far - behind) / fade)
        total += (wu if du else 1 - wu) * (wv if dv else 1 - wv) * full
    return total


def _slanted(z: dict[tuple[int, int], Array], a: Array, b: Array, most: float) -> Array:
    """How much a surface's depth changes in a step of the ray [m], `most` at most; 0 between things that are apart.

    A ray that crosses a surface at a slant is before it at one sample and far behind it at the next.
    """
    across = np.maximum(np.abs(z[1, 0] - z[0, 0]), np.abs(z[1, 1] - z[0, 1]))
    down = np.maximum(np.abs(z[0, 1] - z[0, 0]), np.abs(z[1, 1] - z[1, 0]))
    nearest = np.minimum.reduce(list(z.values()))
    joined = _ramp(2 - np.maximum(across, down) / (JOINED * nearest))
    return joined * np.minimum(STEP * (np.abs(a) * across + np.abs(b) * down), most)


def _ramp(x: Array) -> Array:
    return np.clip(x, 0.0, 1.0)


def _smooth(x: Array) -> Array:
    """0 to 1 without a kink at either end. Perlin 2002."""
    return x**3 * (x * (6 * x - 15) + 10)
