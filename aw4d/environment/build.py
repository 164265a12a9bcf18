"""Environments from parameters: an analytic sky, or a recorded map."""

from __future__ import annotations

import dataclasses
import sys
from functools import cache, lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aw4d import cache as on_disk
from aw4d.environment import latlong, presets, sky, spectrum
from aw4d.environment.latlong import directions, level_irradiance, solid_angles, towards
from aw4d.environment.model import Environment
from aw4d.environment.presets import PRESETS, Preset, clear_sky_lux, sun_lux
from aw4d.environment.spectrum import color_of, sunlight
from aw4d.errors import InputError
from aw4d.io.hdr import read_radiance
from aw4d.params import AmbientParams
from reference_numpy.srgb import LUMINANCE

Array = NDArray[np.float64]

ROWS, COLUMNS = 256, 512  # of an analytic sky's map
GROUND = 0.2  # albedo of what lies below the horizon: soil, grass and asphalt
SUN_DEG = 6.0  # around the brightest spot of a map, within which light counts as the sun's
SUN_PEAK = 200.0  # that spot's luminance over the upper half's mean, from which on there is a sun
SUN_SHARE = 0.1  # of the illuminance of a surface square to it that a sun gives at least


def environment(params: AmbientParams) -> Environment:
    """The environment that the parameters describe, in absolute units.

    Parameters
    ----------
    params
        `map` if it is given, else the analytic sky of `preset`.

    Raises
    ------
    InputError
        The preset has no sun, but its place is given; or the map is wrong.
    """
    return _from_map(params) if params.map else _from_preset(params)


def _from_map(params: AmbientParams) -> Environment:
    """Read anew every time, since the file may have changed. Without `illuminance_lux` it gets the preset's light."""
    if given := _given_of_the_sky(params):
        raise InputError(f"{given[0]}: a map has its own sky; turn it with rotation_deg")
    found = _read_map(Path(params.map), params.rotation_deg)
    if found.illuminance <= 0:
        raise InputError(f"map: {params.map}: expected light from above the horizon, got none")
    preset = PRESETS[params.preset]
    return _scaled(found, params, default_lux=preset.sky_lux + preset.sun_lux)


@lru_cache(maxsize=8)
def _from_preset(params: AmbientParams) -> Environment:
    """Kept, with its tables, since they take a second to make."""
    found = analytic(_adjusted(PRESETS[params.preset], params), params.rotation_deg)
    return _scaled(found, params, default_lux=found.illuminance)


def _given_of_the_sky(params: AmbientParams) -> list[str]:
    """Names of the parameters of a clear sky that are given."""
    return [n for n in ("sun_altitude_deg", "sun_azimuth_deg", "turbidity") if getattr(params, n) is not None]


def _adjusted(preset: Preset, params: AmbientParams) -> Preset:
    """A preset with the sun where the parameters want it; its light changes as that of a clear day does."""
    if preset.sky != "clear" and (given := _given_of_the_sky(params)):
        raise InputError(f"{given[0]}: the preset {params.preset} has no sun in a clear sky")
    changes: dict[str, float] = {}
    if params.sun_altitude_deg is not None:
        before, now = preset.sun_altitude_deg, params.sun_altitude_deg
        sun_before = preset.sun_lux / sun_lux(before) if preset.sun_lux else 1.0
        changes["sky_lux"] = preset.sky_lux * clear_sky_lux(now) / clear_sky_lux(before)
        changes["sun_lux"] = sun_before * sun_lux(now)
        changes["sun_altitude_deg"] = now
    if params.sun_azimuth_deg is not None:
        changes["sun_azimuth_deg"] = params.sun_azimuth_deg
    if params.turbidity is not None:
        changes["turbidity"] = params.turbidity
    return dataclasses.replace(preset, **changes)  # type: ignore[arg-type]


def analytic(preset: Preset, rotation_deg: float = 0.0) -> Environment:
    """A preset's environment, white-balanced for noon as a camera would be that is left alone all day."""
    return _analytic(preset, rotation_deg, _daylight_balance())


@cache
def _daylight_balance() -> Array:
    """Gains that make noon's light on a level surface grey; from disk, since every sky begins with them."""
    key = [on_disk.source_of(sys.modules[__name__], sky, spectrum, latlong, presets)]
    return on_disk.kept("daylight", key, lambda: {"balance": _noon_to_grey()})["balance"]


def _noon_to_grey() -> Array:
    noon = _analytic(PRESETS["noon"], 0.0, np.ones(3))
    light = level_irradiance(noon.radiance) + noon.sun_irradiance * noon.sun_direction[1]
    return float(light @ LUMINANCE) / light


def _analytic(preset: Preset, rotation_deg: float, balance: Array) -> Environment:
    d = directions(ROWS, COLUMNS)
    azimuth = preset.sun_azimuth_deg + rotation_deg
    if preset.sky == "clear":
        radiance = sky.clear(d, preset.sun_altitude_deg, azimuth, preset.turbidity) * balance
    else:
        radiance = (sky.overcast(d) if preset.sky == "overcast" else sky.city_night(d)) * balance
    radiance *= preset.sky_lux / float(level_irradiance(radiance) @ LUMINANCE)
    to_sun = towards(preset.sun_altitude_deg, azimuth)
    sun = np.zeros(3)
    if preset.sun_lux > 0 and to_sun[1] > 0:
        sun = color_of(sunlight(preset.sun_altitude_deg, preset.turbidity)) * balance
        sun *= preset.sun_lux / to_sun[1] / float(sun @ LUMINANCE)
    ground = (level_irradiance(radiance) + sun * max(float(to_sun[1]), 0.0)) * (GROUND / np.pi)
    seen = np.where(d[..., 1:2] > 0, radiance, ground)
    return Environment(radiance=seen, backdrop=radiance, sun_direction=to_sun, sun_irradiance=sun)


def _read_map(path: Path, rotation_deg: float) -> Environment:
    """A recorded map on its own scale, its sun taken out of it."""
    radiance = read_radiance(path)
    radiance = np.roll(radiance, round(rotation_deg / 360 * radiance.shape[1]), axis=1)
    towards_sun, sun, rest = split_sun(radiance)
    return Environment(radiance=rest, backdrop=rest, sun_direction=towards_sun, sun_irradiance=sun)


def split_sun(radiance: Array) -> tuple[Array, Array, Array]:
    """Take the sun out of a map, (H, W, 3).

    Returns
    -------
    towards_sun, irradiance, rest
        (3,) unit, world; (3,) on a surface square to it, 0 where the map holds no sun; (H, W, 3) the map without it.
    """
    height, width = radiance.shape[:2]
    d, weight = directions(height, width), solid_angles(height, width) * np.ones((1, width))
    luminance = radiance @ LUMINANCE
    above = d[..., 1] > 0
    peak = np.unravel_index(np.argmax(np.where(above, luminance, -1.0)), luminance.shape)
    mean = float(np.average(luminance[above], weights=weight[above]))
    nothing = d[peak], np.zeros(3), radiance
    if luminance[peak] <= SUN_PEAK * mean:
        return nothing
    cosine = d @ d[peak]
    near = cosine > np.cos(np.radians(SUN_DEG))
    ring = near & (cosine < np.cos(np.radians(SUN_DEG * 0.7)))
    around = np.median(radiance[ring], axis=0)
    excess = np.where(near[..., None], np.maximum(radiance - around, 0.0), 0.0)
    sun = np.einsum("hwc,hw->c", excess, weight)
    glow = excess @ LUMINANCE * weight
    centre = np.einsum("hw,hwc->c", glow, d)
    centre /= np.linalg.norm(centre)
    facing = float((np.maximum(d @ centre, 0.0) * luminance * weight).sum())
    if float(sun @ LUMINANCE) < SUN_SHARE * facing:
        return nothing
    return centre, sun, radiance - excess


def _scaled(of: Environment, params: AmbientParams, *, default_lux: float) -> Environment:
    """The environment with the light on a level surface that the parameters want."""
    lux = params.illuminance_lux if params.illuminance_lux is not None else default_lux
    gain = params.strength * lux / of.illuminance
    return dataclasses.replace(
        of, radiance=of.radiance * gain, backdrop=of.backdrop * gain, sun_irradiance=of.sun_irradiance * gain
    )
