"""What wet ground mirrors: the frame itself where the mirrored ray meets what it shows, the surroundings elsewhere.

`ambient` has lit the surface with the surroundings in the mirror direction. Here the share c of the reflected lobe that
things of the picture cover is taken from them and given to the things:

    rgb + (F0 A + B) (sum of what covers - c * specular occlusion * L_env),

A and B the shares of the two parts of Schlick's Fresnel term (Karis 2013), L_env the surroundings' radiance in the
lobe. Where the ray finds nothing, c is 0 and nothing changes.

`walk` finds what covers the lobe. Every decision is a ramp, none a comparison: the result is a continuous function of
its inputs and does not flicker.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from reference_numpy.brdf import DIELECTRIC_F0
from reference_numpy.environment import PARTS, Surroundings, lobes, specular_occlusion
from reference_numpy.mirrored import Mirrored
from reference_numpy.ramps import smoothstep
from reference_numpy.walk import NOTHING, Picture, ramp, walk

Array = NDArray[np.float64]

WET = 0.25  # from which wetness on a surface mirrors in full
SMOOTH = 0.5  # [1] of the largest roughness, over which mirroring ends


def reflections(
    *,
    rgb: Array,
    depth: Array,
    normal: Array,
    albedo: Array,
    roughness: Array,
    metallic: Array,
    emissive: Array,
    sky: NDArray[np.bool_],
    puddle: Array,
    wetness: Array,
    occlusion: Array,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    up: Array,
    env_rotation: Array,
    env_specular: Array,
    env_brdf: Array,
    env_zonal: Array,
    env_colour: Array,
    steps: int,
    reach_m: float,
    thickness_m: float,
    max_roughness: float,
) -> dict[str, Array]:
    """A lit frame with reflections of itself on what is wet and smooth.

    Parameters
    ----------
    rgb
        (H, W, 3) radiance, surroundings' reflection included.
    depth, normal, albedo, roughness, metallic, emissive, sky
        (H, W) [m], (H, W, 3) camera frame, (H, W, 3), (H, W), (H, W), (H, W, 3) what of `rgb`
        things send by themselves, (H, W).
    puddle, wetness
        (H, W), 0 to 1; the larger counts.
    occlusion
        (H, W) share of the surroundings that `ambient` took for seen; 0 where it has not run.
    fx, fy, cx, cy
        Intrinsics [px].
    up
        (3,) unit, the world's up in the camera's frame.
    env_rotation, env_specular, env_brdf, env_zonal, env_colour
        See `ambient`.
    steps
        Samples of a ray before finer ones.
    reach_m
        How far things are mirrored [m].
    thickness_m
        How far things reach below what is seen of them [m].
    max_roughness
        Roughness from which on nothing is mirrored.

    Returns
    -------
    dict
        `rgb` (H, W, 3), >= 0; `reflection` (H, W, 3), what of it is mirrored, of things and of the surroundings, >= 0.
    """
    out, mirrored = rgb.copy(), np.zeros_like(rgb)
    wet = ramp(np.maximum(puddle, wetness) / WET) * ~sky
    on = wet * ramp(max_roughness - roughness) > 0
    if not on.any():
        return {"rgb": out, "reflection": mirrored}
    v, u = (i.astype(np.int64) for i in np.nonzero(on))
    picture = Picture(rgb, emissive, np.where(sky, NOTHING, np.minimum(depth, NOTHING)), fy)
    ray = Mirrored(u, v, depth[on], normal[on], roughness[on], fx, fy, cx, cy, np.asarray(up, dtype=np.float64))
    covered, seen = walk(picture, ray, steps, reach_m, thickness_m)
    weight = wet[on] * smoothstep(0.0, 1.0, (max_roughness - roughness[on]) / (SMOOTH * max_roughness)) * ray.fit
    surroundings = Surroundings(specular=env_specular, zonal=env_zonal, colour=env_colour)
    share, L_env = _surroundings(
        ray, np.clip(albedo[on], 0.0, 1.0), roughness[on], metallic[on], env_rotation, env_brdf, surroundings
    )
    weight, around = weight[:, None] * share, specular_occlusion(ray.NoV, occlusion[on], roughness[on])[:, None] * L_env
    mirrored[on] = weight * (seen + np.maximum(1 - covered, 0.0)[:, None] * around)
    out[on] = np.maximum(rgb[on] + weight * (seen - covered[:, None] * around), 0.0)
    return {"rgb": out, "reflection": mirrored}


def _surroundings(
    ray: Mirrored,
    albedo: Array,
    roughness: Array,
    metallic: Array,
    env_rotation: Array,
    env_brdf: Array,
    around: Surroundings,
) -> tuple[Array, Array]:
    """Share that is reflected, (N, 3), and the surroundings' radiance in the lobe, by its mean direction, (N, 3)."""
    found = lobes(env_brdf, ray.NoV, roughness)
    A, B = (found[..., part, 0].sum(axis=-1) for part in PARTS)
    F0 = DIELECTRIC_F0 + (albedo - DIELECTRIC_F0) * metallic[:, None]
    grey = F0.mean(axis=-1)
    weights = np.concatenate([grey[:, None] * found[:, PARTS[0], 0], found[:, PARTS[1], 0]], axis=-1)
    weights /= weights.sum(axis=-1, keepdims=True)
    turn, rough = (weights * found[..., 1]).sum(axis=-1), (weights * found[..., 2]).sum(axis=-1)
    mirror = 2 * ray.NoV[:, None] * ray.n - ray.view
    d = mirror + turn[:, None] * (ray.n - mirror)
    return F0 * A[:, None] + B[:, None], around.prefiltered(d @ env_rotation.T, rough)
