"""What lights the particles that fall through the air."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from reference_numpy.environment import prefiltered
from reference_numpy.lamp import DIRECTIONAL, EPSILON, lamp
from reference_numpy.phase import henyey_greenstein

Array = NDArray[np.float64]


def colors(
    place: Array,
    *,
    lobe: float,
    g: float,
    env_rotation: Array,
    env_specular: Array,
    sun_direction: Array,
    sun_irradiance: Array,
    light_kind: NDArray[np.int32],
    light_position: Array,
    light_direction: Array,
    light_intensity: Array,
    light_cos_inner: Array,
    light_cos_outer: Array,
    light_r_max: Array,
    haze_extinction: float,
    haze_color: Array,
) -> Array:
    """Radiance of particles at some places, (N, 3) camera frame [m], through the haze; (N, 3).

    What is seen through a particle is its surroundings, blurred (`lobe`: the roughness of `prefiltered`); every lamp
    and the sun add E p, the light that falls on it times the phase function (Henyey and Greenstein's, of `g`).
    """
    distance = np.sqrt((place**2).sum(axis=1))
    view = place / np.maximum(distance, 1e-9)[:, None]
    seen = prefiltered(env_specular, view @ np.asarray(env_rotation).T, np.full(len(place), lobe))
    seen += henyey_greenstein(view @ sun_direction, g=g)[:, None] * sun_irradiance
    for i in range(len(light_kind)):
        if light_kind[i] == DIRECTIONAL:
            direction = light_direction[i] / np.linalg.norm(light_direction[i])
            falls = henyey_greenstein(-(view @ direction), g=g)
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
            to_lamp = source.position - place
            d2 = (to_lamp**2).sum(axis=1)
            to_lamp /= np.sqrt(np.maximum(d2, 1e-18))[:, None]
            mu = np.einsum("nc,nc->n", view, to_lamp)
            light = source.cone(-(to_lamp @ source.direction)) * source.window(d2) / (d2 + EPSILON)
            falls = light * henyey_greenstein(mu, g=g)
        seen += falls[:, None] * light_intensity[i]
    left = np.exp(-haze_extinction * distance)[:, None]
    return left * seen - np.expm1(-haze_extinction * distance)[:, None] * np.asarray(haze_color)
