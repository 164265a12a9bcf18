"""Drops near the camera before a picture. Paper, supplement "Precipitation Dynamics"."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from reference_numpy.particles import particles

Array = NDArray[np.float64]


def rain_streaks(
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
) -> dict[str, Array]:
    """Draw drops.

    Parameters
    ----------
    rgb, depth, sky, ...
        All as `particles.particles` takes them.

    Returns
    -------
    dict
        `rgb` (H, W, 3); `streak_alpha` (H, W) share of a pixel's light that drops hide; `streak_depth` (H, W) depth of
        the nearest drop that covers half of the pixel, or of the surface [m].
    """
    picture, alpha, nearest = particles(**locals())
    return {"rgb": picture, "streak_alpha": alpha, "streak_depth": nearest}
