"""Drops near the camera before a picture. Paper, supplement "Precipitation Dynamics".

Where they are and how they show: `particles`. A drop turns the world upside down and gathers nearly half of
it, most of it from ahead.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from reference_numpy.particles import blend, capsules, colors, in_front, in_order, places

Array = NDArray[np.float64]

LOBE = 5 / 7  # roughness of the blur in which surroundings are seen through a drop


def rain_streaks(
    *,
    rgb: Array,
    depth: Array,
    sky: NDArray[np.bool_],
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    rain_count: int,
    rain_at: NDArray[np.uint32],
    rain_corner: NDArray[np.int32],
    rain_axes: Array,
    rain_move: Array,
    rain_steps: float,
    rain_taper: float,
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
) -> dict[str, Array]:
    """Draw drops.

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
    rain_count, rain_at, rain_corner, rain_axes, rain_move
        Number, places and motion of the drops, see `aw4d.world.falling.particle_arguments`.
    rain_steps
        Steps of depth a metre by which they are put in order.
    rain_taper
        Radius of a streak's tail over that of its head.
    light_kind, light_position, light_direction, light_intensity, light_cos_inner, light_cos_outer, light_r_max
        Local lights, see `fog`.
    env_rotation, env_specular
        (3, 3) camera to world; (L, N, N, 4) prefiltered radiance, see `environment.prefiltered`.
    sun_direction, sun_irradiance
        (3,) unit, towards the sun, camera frame; (3,) of a surface square to it.
    haze_extinction, haze_color
        Of what hangs between the drops [1/m]; (3,) linear.
    near_m, reach_m
        Depth and distance between which drops show [m].
    opacity
        Strength of drops.
    g
        Mean cosine of the angle by which a drop turns light.
    aperture_mm, focus_m
        Width of the lens' opening, and depth in focus.
    seed
        By which places are drawn.
    convention
        "physical" or "paper", see `particles.capsules`.

    Returns
    -------
    dict
        `rgb` (H, W, 3); `streak_alpha` (H, W) share of a pixel's light that drops hide; `streak_depth` (H, W) depth of
        the nearest drop that covers half of the pixel, or of the surface [m].
    """
    shown = capsules(
        *places(rain_count, rain_at, rain_corner, rain_axes, seed),
        move=rain_move,
        taper=rain_taper,
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
    shown = shown.take(in_order(shown.depth, rain_steps))
    color = colors(
        shown.place,
        lobe=LOBE,
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
    picture, alpha, nearest = blend(shown, color, rgb=rgb, depth=depth, sky=sky)
    return {"rgb": picture, "streak_alpha": alpha, "streak_depth": nearest}
