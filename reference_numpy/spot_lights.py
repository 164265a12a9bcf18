"""Local lights on the surfaces, and what shines by itself. Paper, supplement "Light Source Implementation".

    L = E + sum_j f_r NoL I_j S_j W_j / (d^2 + eps)

with the Cook-Torrance f_r of `brdf`, angular falloff S and distance window W of `lamp`, and emitted radiance E. The
lights cast no shadows: the frame does not show what stands between a lamp and what it lights.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from reference_numpy.brdf import brdf
from reference_numpy.lamp import DIRECTIONAL, EPSILON, lamp
from reference_numpy.sampling import rays

Array = NDArray[np.float64]


def spot_lights(
    *,
    depth: Array,
    normal: Array,
    albedo: Array,
    roughness: Array,
    metallic: Array,
    emissive: Array,
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
    convention: str,
) -> dict[str, Array]:
    """Radiance that the local lights and the surfaces' own emission send to the eye.

    Parameters
    ----------
    depth
        (H, W) z of the surfaces [m], > 0.
    normal
        (H, W, 3) camera frame; normalised here, since a stored one is unit to a few thousandths.
    albedo
        (H, W, 3), taken for 0 to 1.
    roughness, metallic
        (H, W), 0 to 1.
    emissive
        (H, W, 3) radiance that the surface sends by itself.
    sky
        (H, W) True where the ray meets no surface: no light falls there.
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
    convention
        "physical" or "paper", see `brdf`.

    Returns
    -------
    dict
        `direct` (H, W, 3), >= 0.
    """
    direct = np.array(emissive, dtype=np.float64)
    ray, stretch = rays(depth.shape, fx=fx, fy=fy, cx=cx, cy=cy)
    where = np.nonzero(~sky & np.isfinite(depth))
    position = ray[where] * (depth * stretch)[where][:, None]
    surface = {
        "normal": _unit(normal[where]),
        "view": -ray[where],
        "albedo": np.clip(albedo[where], 0.0, 1.0),
        "roughness": roughness[where],
        "metallic": metallic[where],
    }
    for i in range(len(light_kind)):
        if light_kind[i] == DIRECTIONAL:
            to_light = np.broadcast_to(-_unit(np.asarray(light_direction[i], dtype=np.float64)), position.shape)
            falloff = np.ones(len(position))
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
            across = source.position - position
            d2 = np.einsum("...c,...c->...", across, across)
            to_light = across / np.sqrt(np.maximum(d2, 1e-18))[:, None]
            falloff = source.cone(-(to_light @ source.direction)) * source.window(d2) / (d2 + EPSILON)
        lit = falloff > 0  # a lamp reaches little of the frame
        one = {name: value[lit] for name, value in surface.items()}
        f_r = brdf(light=to_light[lit], **one, convention=convention)
        NoL = np.maximum(np.einsum("...c,...c->...", surface["normal"][lit], to_light[lit]), 0.0)
        radiance = f_r * (NoL * falloff[lit])[:, None] * light_intensity[i]
        at = tuple(index[lit] for index in where)
        direct[at] += radiance
    return {"direct": direct}


def _unit(vector: Array) -> Array:
    """Vectors of length 1; a zero vector stays."""
    length = np.linalg.norm(vector, axis=-1, keepdims=True)
    return vector / np.maximum(length, 1e-18)
