"""Radiance of skies by direction, on any scale: clear, twilight, overcast, city night.

All are functions of unit directions in the world (..., 3) and give linear Rec. 709 (..., 3). Below the horizon they
show what is at the horizon; the ground is the caller's.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from aw4d.environment.latlong import towards
from aw4d.environment.spectrum import color_of, color_of_temperature, from_xyY, sunlight

Array = NDArray[np.float64]

LOWEST_DEG = 4.0  # altitude of the sun below which the daylight model is not used: it turns green and then negative
DUSK_DEG = (0.0, 5.0)  # altitudes of the sun between which twilight goes over into daylight

# Perez' coefficients A to E as slope and offset in turbidity, for Y, x, y. Preetham, Shirley, Smits 1999, appendix 2.
_PEREZ = np.array(
    [
        [[0.1787, -1.4630], [-0.3554, 0.4275], [-0.0227, 5.3251], [0.1206, -2.5771], [-0.0670, 0.3703]],
        [[-0.0193, -0.2592], [-0.0665, 0.0008], [-0.0004, 0.2125], [-0.0641, -0.8989], [-0.0033, 0.0452]],
        [[-0.0167, -0.2608], [-0.0950, 0.0092], [-0.0079, 0.2102], [-0.0441, -1.6537], [-0.0109, 0.0529]],
    ]
)
# Zenith chromaticity: rows for T^2, T, 1; columns for theta^3, theta^2, theta, 1. Same source.
_ZENITH = np.array(
    [
        [
            [0.00166, -0.00375, 0.00209, 0.0],
            [-0.02903, 0.06377, -0.03202, 0.00394],
            [0.11693, -0.21196, 0.06052, 0.25886],
        ],
        [
            [0.00275, -0.00610, 0.00317, 0.0],
            [-0.04214, 0.08970, -0.04153, 0.00516],
            [0.15346, -0.26756, 0.06670, 0.26688],
        ],
    ]
)


def _smoothstep(low: float, high: float, x: float) -> float:
    t = min(max((x - low) / (high - low), 0.0), 1.0)
    return t * t * (3 - 2 * t)


def _perez(coefficients: Array, cos_theta: Array, gamma: Array, cos_gamma: Array) -> Array:
    """Perez, Seals and Michalsky 1993."""
    A, B, C, D, E = coefficients
    return (1 + A * np.exp(B / cos_theta)) * (1 + C * np.exp(D * gamma) + E * cos_gamma**2)


def daylight(d: Array, altitude_deg: float, azimuth_deg: float, turbidity: float) -> Array:
    """Clear sky with the sun up. Preetham, Shirley and Smits 1999; 1.9 <= turbidity <= 10 makes sense."""
    altitude_deg = max(altitude_deg, LOWEST_DEG)
    cos_gamma = np.clip(d @ towards(altitude_deg, azimuth_deg), -1, 1)
    gamma = np.arccos(cos_gamma)
    cos_theta = np.maximum(d[..., 1], 0.01)
    theta_s = np.radians(90 - altitude_deg)
    powers = np.array([theta_s**3, theta_s**2, theta_s, 1.0])
    x, y = np.array([turbidity**2, turbidity, 1.0]) @ _ZENITH @ powers
    found = []
    for zenith, slopes in zip((1.0, x, y), _PEREZ, strict=True):
        c = slopes @ np.array([turbidity, 1.0])
        at_zenith = _perez(c, np.ones(1), np.full(1, theta_s), np.full(1, np.cos(theta_s)))
        found.append(zenith * _perez(c, cos_theta, gamma, cos_gamma) / at_zenith)
    return from_xyY(found[1], found[2], np.maximum(found[0], 0.0))


def twilight(d: Array, altitude_deg: float, azimuth_deg: float) -> Array:
    """Clear sky with the sun at or below the horizon.

    A blue vault, a warm band over the sun and a faint pink one opposite. The colours are those of sunlight behind much
    air and of black bodies; how they are spread was chosen by eye, after photographs, not measured.
    """
    height = np.degrees(np.arcsin(np.clip(d[..., 1], 0, 1)))
    level = np.maximum(np.hypot(d[..., 0], d[..., 2]), 1e-9)
    facing = np.clip((d @ towards(0, azimuth_deg)) / level, -1, 1)  # 1 over the sun, -1 opposite
    deep = _smoothstep(0.0, 6.0, -altitude_deg)
    vault = color_of_temperature(14_000 + 30_000 * deep)
    glow = color_of(sunlight(1.5, 2.5))
    pink = 0.55 * color_of(sunlight(4.0, 2.0)) + 0.45 * color_of_temperature(20_000)
    over_sun = np.exp(-height / (7.0 - 3.0 * deep)) * ((1 + facing) / 2) ** (2 + 2 * deep)
    opposite = np.exp(-(((height - 8.0) / 7.0) ** 2)) * ((1 - facing) / 2)
    brighter_low = 1 + 1.2 * np.exp(-height / 20.0) * (1 + 0.5 * facing)
    return (
        vault * brighter_low[..., None]
        + (5.0 - 2.0 * deep) * glow * over_sun[..., None]
        + 0.9 * (1 - deep) * pink * opposite[..., None]
    )


def clear(d: Array, altitude_deg: float, azimuth_deg: float, turbidity: float) -> Array:
    """Clear sky at any altitude of the sun."""
    day = _smoothstep(*DUSK_DEG, altitude_deg)
    out = np.zeros(d.shape)
    if day > 0:
        out += day * _even(daylight(d, altitude_deg, azimuth_deg, turbidity), d)
    if day < 1:
        out += (1 - day) * _even(twilight(d, altitude_deg, azimuth_deg), d)
    return out


def _even(radiance: Array, d: Array) -> Array:
    """Scaled to a mean of 1, in green, above the horizon, so that skies can be mixed."""
    return radiance / float(np.mean(radiance[d[..., 1] > 0][:, 1]))


def overcast(d: Array) -> Array:
    """The CIE's overcast sky: (1 + 2 sin(height)) / 3 of the zenith. Moon and Spencer 1942."""
    up = np.maximum(d[..., 1], 0.0)
    return ((1 + 2 * up) / 3)[..., None] * color_of_temperature(6300)


def city_night(d: Array) -> Array:
    """Sky over a town at night: the glow of its lamps, three times as bright at the horizon as overhead, and warmer.

    The spread was chosen by eye.
    """
    low = np.exp(-np.degrees(np.arcsin(np.clip(d[..., 1], 0, 1))) / 18.0)[..., None]
    return color_of_temperature(8000) * (1 - 0.4 * low) + 2.4 * color_of_temperature(3300) * low
