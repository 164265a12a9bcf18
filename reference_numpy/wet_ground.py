"""Wet surfaces: darker where they are porous, and smoother. Paper, supplement "Wet ground implementation".

A surface that is wet to the share i takes

    A = (1 - i) A_dry + i A_wet,   A_wet = A_dry (1 - p) + A_water p exp(-tau / mu),   r = r_dry + f i (r_water - r_dry)

of albedo and roughness, mu the cosine of the view; f is 1 but where it is said. Two conventions:

physical
    i = intensity ((1 + n.up) / 2)^2 (1 - snow): rain wets whatever lies open to the sky, and does not drip upwards.
    p = porosity (1 - metallic) clip((r_dry - 0.5) / 0.4): asphalt and brick are porous, paint and glass are not
    (Lagarde 2013). Water neither brightens what is darker than itself nor roughens what is smoother. Off the road
    f = film: grass, leaves and walls hold no closed film that would shine.
paper
    i = intensity (1 - snow) on the road alone, p = porosity whatever the surface.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from reference_numpy.sampling import rays

Array = NDArray[np.float64]


def unit_normals(normal: Array) -> Array:
    """Normals (..., 3) of length 1; those of length 0 stay so."""
    length = np.sqrt(np.einsum("...c,...c->...", normal, normal))
    return normal / np.maximum(length, 1e-18)[..., None]


def open_to_the_sky(n: Array, up: Array) -> Array:
    """Share of the sky that surfaces of unit normals face, (1 + n.up) / 2.

    Taken by the way from n to the nearer one of up and down, |n + up|^2 / 4 or 1 - |n - up|^2 / 4: below an overhang a
    rounded `up` leaves n.up + 1 no digits.
    """
    above, below = (np.einsum("...c,...c->...", way, way) / 4 for way in (n - up, n + up))
    return np.where(n @ up < 0, below, 1 - above)


def porousness(roughness: Array, metallic: Array) -> Array:
    """How porous surfaces are, 0 to 1. Lagarde 2013 ("Water drop 3b")."""
    out: Array = np.clip((roughness - 0.5) / 0.4, 0.0, 1.0) * (1 - metallic)
    return out


def wet_ground(
    *,
    albedo: Array,
    roughness: Array,
    metallic: Array,
    normal: Array,
    sky: NDArray[np.bool_],
    road: NDArray[np.bool_],
    snow_bare: Array,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    up: Array,
    intensity: float,
    porosity: float,
    water_albedo: float,
    water_roughness: float,
    film: float,
    optical_depth: float,
    convention: str,
) -> dict[str, Array]:
    """Wet the surfaces.

    Parameters
    ----------
    albedo, normal
        (H, W, 3) linear, and of any length, camera frame.
    roughness, metallic, snow_bare
        (H, W), 0 to 1.
    sky, road
        (H, W) True where the sky is seen, which stays as it is, and on drivable ground.
    fx, fy, cx, cy
        Intrinsics [px].
    up
        (3,) the world's up, unit, camera frame.
    intensity
        Wetness of level surfaces, 0 to 1.
    porosity
        Of the most porous surface, 0 to 1.
    water_albedo, water_roughness
        0 to 1.
    film
        How much of the smoothing surfaces off the road get, 0 to 1.
    optical_depth
        tau of the water on the surface, seen from above.
    convention
        "physical" or "paper".

    Returns
    -------
    dict
        `albedo` (H, W, 3), `roughness` (H, W), and `wetness` (H, W), the i above.
    """
    n = unit_normals(normal)
    closed = np.ones(roughness.shape)
    if convention == "paper":
        wet = intensity * road * snow_bare
        p = np.full(roughness.shape, porosity)
        water, smooth = np.full_like(albedo, water_albedo), np.full(roughness.shape, water_roughness)
    else:
        wet = intensity * open_to_the_sky(n, np.asarray(up)) ** 2 * snow_bare
        p = porosity * porousness(roughness, metallic)
        water, smooth = np.minimum(albedo, water_albedo), np.minimum(roughness, water_roughness)
        closed[~road] = film
    wet = np.where(sky, 0.0, wet)
    ray, _ = rays(sky.shape, fx=fx, fy=fy, cx=cx, cy=cy)
    mu = np.maximum(-np.einsum("...c,...c->...", n, ray), 1e-6)  # at a grazing view tau = 0 still lets all through
    through = np.exp(-optical_depth / mu)[..., None]
    share = (wet * p)[..., None]
    return {
        "albedo": albedo + share * (water * through - albedo),
        "roughness": roughness + closed * wet * (smooth - roughness),
        "wetness": wet,
    }
