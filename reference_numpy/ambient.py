"""Light of the surroundings on the surfaces: sky and ground, their reflection, and the sun. Paper, "Environment".

    L = (d + m) E / pi * occlusion + (F0 L_A + L_B) * specular occlusion + f_r NoL E_sun * shadow

E is the irradiance of the surroundings on the surface; L_A and L_B their light by the two parts of Schlick's Fresnel
term (a split sum, Karis 2013, over round lobes of `environment.lobes`), A and B the same in white surroundings of 1.
What the surface reflects more than once, m, and what is left for the pigment, d, follow from A and B (Fdez-Aguera
2019), so that a white surface in a white surrounding reflects exactly what it gets. The sky shows the surroundings
themselves.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from reference_numpy.brdf import DIELECTRIC_F0, MIN_NOV, brdf
from reference_numpy.environment import PARTS, Surroundings, lobes, lookup, reflection, specular_occlusion
from reference_numpy.occlusion import ambient_occlusion
from reference_numpy.sampling import rays
from reference_numpy.shadow import sun_shadow

Array = NDArray[np.float64]


def ambient(
    *,
    depth: Array,
    normal: Array,
    albedo: Array,
    roughness: Array,
    metallic: Array,
    sky: NDArray[np.bool_],
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    env_rotation: Array,
    env_irradiance: Array,
    env_specular: Array,
    env_brdf: Array,
    env_backdrop: Array,
    env_zonal: Array,
    env_colour: Array,
    sun_direction: Array,
    sun_irradiance: Array,
    shadow_steps: int,
    shadow_distance_m: float,
    thickness_m: float,
    occlusion_radius_m: float,
    occlusion_slices: int,
    occlusion_steps: int,
) -> dict[str, Array]:
    """Radiance of a frame under the light of its surroundings.

    Parameters
    ----------
    depth
        (H, W) z of the surfaces [m], > 0.
    normal
        (H, W, 3) camera frame; normalised here.
    albedo
        (H, W, 3), taken for 0 to 1.
    roughness, metallic
        (H, W), 0 to 1.
    sky
        (H, W) True where the ray meets no surface.
    fx, fy, cx, cy
        Intrinsics [px].
    env_rotation
        (3, 3) camera to world.
    env_irradiance
        (N, N, 4) irradiance by the surface's normal in the world, octahedral; see `environment`.
    env_specular
        (L, N, N, 4) prefiltered radiance by roughness and direction.
    env_brdf
        (M, M, LOBES, 4) the lobes that stand for the reflection's; see `environment.lobes`.
    env_backdrop
        (B, B, 4) radiance by direction, for the sky.
    env_zonal, env_colour
        (L, E, 4), (3,) in place of `env_irradiance` and `env_specular` where E is not 0; see `environment.zonal`.
    sun_direction, sun_irradiance
        (3,) unit, towards the sun, camera frame; (3,) on a surface square to it, 0: no sun.
    shadow_steps, shadow_distance_m, thickness_m
        See `shadow`.
    occlusion_radius_m, occlusion_slices, occlusion_steps
        See `occlusion`.

    Returns
    -------
    dict
        `rgb` and `ambient` (H, W, 3), >= 0, the same; `shadow` (H, W), the share of the sun that arrives; `occlusion`
        (H, W), the share of the surroundings that a surface sees.
    """
    camera = {"fx": fx, "fy": fy, "cx": cx, "cy": cy}
    sky = sky | ~np.isfinite(depth)
    normal = normal / np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-18)
    ray, _ = rays(depth.shape, **camera)
    shadow = np.ones(depth.shape)
    if np.any(sun_irradiance):
        shadow = sun_shadow(
            depth=depth,
            sky=sky,
            normal=normal,
            **camera,
            sun_direction=sun_direction,
            shadow_steps=shadow_steps,
            shadow_distance_m=shadow_distance_m,
            thickness_m=thickness_m,
        )
    occlusion = ambient_occlusion(
        depth=depth,
        sky=sky,
        normal=normal,
        **camera,
        occlusion_radius_m=occlusion_radius_m,
        occlusion_slices=occlusion_slices,
        occlusion_steps=occlusion_steps,
    )
    on = ~sky
    surface = {
        "normal": normal[on],
        "view": -ray[on],
        "albedo": np.clip(albedo[on], 0.0, 1.0),
        "roughness": roughness[on],
        "metallic": metallic[on],
    }
    rgb = np.empty((*depth.shape, 3))
    rgb[sky] = lookup(env_backdrop, ray[sky] @ env_rotation.T)
    rgb[on] = reflected(
        **surface,
        occlusion=occlusion[on],
        env_rotation=env_rotation,
        env_irradiance=env_irradiance,
        env_brdf=env_brdf,
        around=Surroundings(specular=env_specular, zonal=env_zonal, colour=env_colour),
    )
    if np.any(sun_irradiance):
        to_sun = np.broadcast_to(np.asarray(sun_direction, dtype=np.float64), surface["normal"].shape)
        f_r = brdf(light=to_sun, **surface, convention="physical")
        NoL = np.maximum(np.einsum("...c,...c->...", surface["normal"], to_sun), 0.0)
        rgb[on] += f_r * (NoL * shadow[on])[:, None] * sun_irradiance
    return {"rgb": rgb, "ambient": rgb, "shadow": shadow, "occlusion": occlusion}


def reflected(
    *,
    normal: Array,
    view: Array,
    albedo: Array,
    roughness: Array,
    metallic: Array,
    occlusion: Array,
    env_rotation: Array,
    env_irradiance: Array,
    env_brdf: Array,
    around: Surroundings,
) -> Array:
    """Radiance that surfaces, (N,) of them, send back of what surrounds them, without the sun, (N, 3)."""
    NoV = np.clip(np.einsum("...c,...c->...", normal, view), MIN_NOV, 1.0)
    mirror = 2 * NoV[:, None] * normal - view
    E = around.irradiance_on(normal @ env_rotation.T, env_irradiance)
    found = lobes(env_brdf, NoV, roughness)
    to_world = {"mirror": mirror @ env_rotation.T, "normal": normal @ env_rotation.T}
    L_A, L_B = (reflection(around, found[..., part, :], **to_world) for part in PARTS)
    A, B = (found[..., part, 0].sum(axis=-1)[..., None] for part in PARTS)
    F0 = DIELECTRIC_F0 + (albedo - DIELECTRIC_F0) * metallic[:, None]
    # A half metal is a mixture of a metal and a dielectric, of which each keeps its energy.
    metal, again = metallic[:, None], _reflected_again(np.array(DIELECTRIC_F0), A, B)
    inside = 1 - (DIELECTRIC_F0 * A + B) - again
    diffuse = (1 - metal) * (albedo * inside + again) + metal * _reflected_again(albedo, A, B)
    specular = F0 * L_A + L_B
    open_ = specular_occlusion(NoV, occlusion, roughness)[:, None]
    return diffuse * E * (occlusion[:, None] / np.pi) + specular * open_


def _reflected_again(F0: Array, A: Array, B: Array) -> Array:
    """Share of white surroundings' light that the microfacets reflect more than once. Fdez-Aguera 2019."""
    lost = 1 - (A + B)  # of the light on a perfect mirror
    mean = F0 + (1 - F0) / 21  # of Schlick's F over the half space
    return (F0 * A + B) * mean * lost / (1 - mean * lost)
