"""Named times of the day: where the sun stands, and how much light there is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from aw4d.environment.spectrum import air_mass


@dataclass(frozen=True, kw_only=True)
class Preset:
    """Sky and sun of a time of the day.

    Parameters
    ----------
    sky
        Which sky: "clear", "overcast" or "city night".
    sun_altitude_deg, sun_azimuth_deg
        Of the sun [deg], clockwise from world -z; of no meaning without one.
    turbidity
        Haze of a clear sky.
    sky_lux, sun_lux
        Illuminance of a level surface by the sky and by the sun [lux].
    """

    sky: Literal["clear", "overcast", "city night"]
    sun_altitude_deg: float = 0.0
    sun_azimuth_deg: float = 180.0
    turbidity: float = 3.0
    sky_lux: float
    sun_lux: float = 0.0


PRESETS: dict[str, Preset] = {
    "noon": Preset(sky="clear", sun_altitude_deg=55, sky_lux=20_000, sun_lux=80_000),
    "golden_hour": Preset(
        sky="clear", sun_altitude_deg=6, sun_azimuth_deg=250, turbidity=2.2, sky_lux=5_500, sun_lux=2_000
    ),
    "dawn": Preset(sky="clear", sun_altitude_deg=1.5, sun_azimuth_deg=80, sky_lux=1_300, sun_lux=35),
    "blue_hour": Preset(sky="clear", sun_altitude_deg=-5, sun_azimuth_deg=280, sky_lux=8),
    "overcast": Preset(sky="overcast", sky_lux=10_000),
    "midnight": Preset(sky="city night", sky_lux=0.5),
}

# Clear sky on a level surface by the sun's altitude [deg, lux]. Below the horizon: after Bond and Henderson 1963; from
# 5 degrees on 800 + 15,500 sqrt(sin) (Gillette and Pierpoint 1982); between, lines through the logarithms.
_TWILIGHT = ((-18.0, 6.5e-4), (-12.0, 8.3e-3), (-6.0, 3.4), (-5.0, 8.0), (-0.8, 453.0), (0.0, 700.0), (5.0, 5_376.0))
_SUN_ABOVE_AIR = 127_500.0  # [lux], same source, with an optical depth of 0.21


def clear_sky_lux(altitude_deg: float) -> float:
    """Illuminance of a level surface by a clear sky, without the sun [lux]."""
    if altitude_deg >= _TWILIGHT[-1][0]:
        return float(800 + 15_500 * np.sqrt(np.sin(np.radians(altitude_deg))))
    altitudes, lux = zip(*_TWILIGHT, strict=True)
    return float(np.exp(np.interp(altitude_deg, altitudes, np.log(lux))))


def sun_lux(altitude_deg: float) -> float:
    """Illuminance of a level surface by the sun alone [lux]; 0 below the horizon."""
    up = max(float(np.sin(np.radians(altitude_deg))), 0.0)
    return _SUN_ABOVE_AIR * up * float(np.exp(-0.21 * air_mass(altitude_deg)))
