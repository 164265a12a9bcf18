"""What falls through the air, before a picture: all that `rain_streaks` and `snow_fall` share."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from reference_numpy.blending import blend, in_order
from reference_numpy.capsules import capsules, in_front, places
from reference_numpy.particle_light import colors

Array = NDArray[np.float64]


def particles(
    *,
    rgb: Array,
    depth: Array,
    sky: NDArray[np.bool_],
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    particle_count: int,
    particle_at: NDArray[np.uint32],
    particle_corner: NDArray[np.int32],
    particle_axes: Array,
    particle_move: Array,
    particle_steps: float,
    particle_taper: float,
    particle_lobe: float,
    light_kind: NDArray[np.int32],
    light_position: Array,
    light_direction: Array,
    light_intensity: Array,
    light_cos_inner: Array,
    light_cos_outer: Array,
    light_r_max: Array,
    env_rotation: Array,
    env_specular: Array,
    sun_direction: Array,
    sun_irradiance: Array,
    haze_extinction: float,
    haze_color: Array,
    near_m: float,
    reach_m: float,
    opacity: float,
    g: float,
    aperture_mm: float,
    focus_m: float,
    seed: int,
    convention: str,
) -> tuple[Array, Array, Array]:
    """Draw particles.

    Parameters
    ----------
    rgb
        (H, W, 3) scene-linear radiance, >= 0.
    depth
        (H, W) z of the surfaces [m].
    sky
        (H, W) True where the ray meets no surface.
    fx, fy, cx, cy
        Intrinsics [px].
    particle_count, particle_at, particle_corner, particle_axes, particle_move
        Number, places and motion of the particles, see `aw4d.world.falling.particle_arguments`.
    particle_steps
        Steps of depth a metre by which they are put in order.
    particle_taper
        Radius of a capsule's tail over that of its head.
    particle_lobe
        Roughness of the blur in which surroundings are seen through a particle, see `particle_light.colors`.
    light_kind, light_position, light_direction, light_intensity, light_cos_inner, light_cos_outer, light_r_max
        Local lights, see `fog`.
    env_rotation, env_specular
        (3, 3) camera to world; (L, N, N, 4) prefiltered radiance, see `environment.prefiltered`.
    sun_direction, sun_irradiance
        (3,) unit, towards the sun, camera frame; (3,) of a surface square to it.
    haze_extinction, haze_color
        Of what hangs between the particles [1/m]; (3,) linear.
    near_m, reach_m
        Depth and distance between which particles show [m].
    opacity
        Strength of particles.
    g
        Mean cosine of the angle by which a particle turns light.
    aperture_mm, focus_m
        Width of the lens' opening, and depth in focus.
    seed
        By which places are drawn.
    convention
        "physical" or "paper", see `capsules.capsules`.

    Returns
    -------
    rgb, alpha, depth
        See `blending.blend`.
    """
    shown = capsules(
        *places(particle_count, particle_at, particle_corner, particle_axes, seed),
        move=particle_move,
        taper=particle_taper,
        fx=fx,
        fy=fy,
        cx=cx,
        cy=cy,
        near_m=near_m,
        reach_m=reach_m,
        opacity=opacity,
        aperture_mm=aperture_mm,
        focus_m=focus_m,
        convention=convention,
    )
    height, width = depth.shape
    shown = shown.take(in_front(shown, width, height))
    shown = shown.take(in_order(shown.depth, particle_steps))
    color = colors(
        shown.place,
        lobe=particle_lobe,
        g=g,
        env_rotation=env_rotation,
        env_specular=env_specular,
        sun_direction=sun_direction,
        sun_irradiance=sun_irradiance,
        light_kind=light_kind,
        light_position=light_position,
        light_direction=light_direction,
        light_intensity=light_intensity,
        light_cos_inner=light_cos_inner,
        light_cos_outer=light_cos_outer,
        light_r_max=light_r_max,
        haze_extinction=haze_extinction,
        haze_color=haze_color,
    )
    return blend(shown, color, rgb=rgb, depth=depth, sky=sky)
