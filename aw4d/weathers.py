"""Weathers by name and in combination: which passes they run, and how `--set group.field=value` reaches them."""

from __future__ import annotations

import dataclasses
import difflib
import typing
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from aw4d.errors import InputError
from aw4d.params import (
    DEFAULT_VISIBILITY_M,
    RGB,
    AmbientParams,
    ExposureParams,
    FogParams,
    HarmonizeParams,
    HeadlightParams,
    LightParams,
    NightGradeParams,
    OvercastSkyParams,
    Params,
    PuddlesParams,
    RainParams,
    RainStreaksParams,
    ReflectionsParams,
    RipplesParams,
    SnowCoverParams,
    SnowFallParams,
    SnowParams,
    SpotLightsParams,
    StreetLampParams,
    VehicleLightParams,
    WetGroundParams,
)
from aw4d.quality import DEFAULT_QUALITY, quality_sets


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Parameters of everything that an edit can run, by group."""

    ambient: AmbientParams = field(default_factory=AmbientParams)
    exposure: ExposureParams = field(default_factory=ExposureParams)
    fog: FogParams = field(default_factory=FogParams)
    harmonize: HarmonizeParams = field(default_factory=HarmonizeParams)
    headlights: HeadlightParams = field(default_factory=HeadlightParams)
    lights: LightParams = field(default_factory=LightParams)
    night_grade: NightGradeParams = field(default_factory=NightGradeParams)
    overcast_sky: OvercastSkyParams = field(default_factory=OvercastSkyParams)
    puddles: PuddlesParams = field(default_factory=PuddlesParams)
    rain: RainParams = field(default_factory=RainParams)
    rain_streaks: RainStreaksParams = field(default_factory=RainStreaksParams)
    reflections: ReflectionsParams = field(default_factory=ReflectionsParams)
    ripples: RipplesParams = field(default_factory=RipplesParams)
    snow: SnowParams = field(default_factory=SnowParams)
    snow_cover: SnowCoverParams = field(default_factory=SnowCoverParams)
    snow_fall: SnowFallParams = field(default_factory=SnowFallParams)
    spot_lights: SpotLightsParams = field(default_factory=SpotLightsParams)
    street_lamps: StreetLampParams = field(default_factory=StreetLampParams)
    vehicle_lights: VehicleLightParams = field(default_factory=VehicleLightParams)
    wet_ground: WetGroundParams = field(default_factory=WetGroundParams)


GROUPS: dict[str, type[Params]] = typing.get_type_hints(Settings)


# The order in which passes run: the ground is made, then lit, then looked at through what falls and hangs in the air.
ORDER = (
    "snow_cover",
    "wet_ground",
    "puddles",
    "ripples",
    "ambient",
    "overcast_sky",
    # The night's grading is for what no lamp lights (paper, "Nocturnal Local Relighting"): lamps keep their colour.
    "night_grade",
    "spot_lights",
    "harmonize",
    "reflections",
    "fog",
    "snow_fall",
    "rain_streaks",
)


@dataclass(frozen=True, kw_only=True)
class Weather:
    """A named weather.

    Parameters
    ----------
    passes
        What it is made of, but for its light.
    sets
        What it sets other than the defaults.
    light, light_sets
        The passes of the light that belongs to it, and what they are set to. Of a combination only one weather's
        light counts: that of the hour, if one is named, else of one that is nothing but light, else of the first.
    hour
        Whether it is a time of the day.
    """

    passes: tuple[str, ...] = ()
    sets: tuple[str, ...] = ()
    light: tuple[str, ...] = ("ambient", "spot_lights", "harmonize")
    light_sets: tuple[str, ...]
    hour: bool = False


_CLOUDS = ("ambient", "overcast_sky", "spot_lights", "harmonize")
# Between drops and flakes; they fall from clouds, and what is above those is not seen through them.
_AIR = ("fog.visibility_m=20000", "fog.extent_m=1000")

WEATHERS: dict[str, Weather] = {
    "snow": Weather(
        passes=("snow_cover", "wet_ground", "fog", "snow_fall"),
        sets=_AIR,
        light=_CLOUDS,
        light_sets=("ambient.preset=overcast", "lights.street=off"),
    ),
    "rain": Weather(
        passes=("wet_ground", "puddles", "ripples", "reflections", "fog", "rain_streaks"),
        sets=_AIR,
        light=_CLOUDS,
        light_sets=("ambient.preset=overcast", "ambient.illuminance_lux=4000", "lights.street=off"),
    ),
    # Dense fog in deep dusk, headlights on.
    "fog": Weather(
        passes=("fog",),
        sets=(f"fog.visibility_m={DEFAULT_VISIBILITY_M:g}",),
        light_sets=("ambient.preset=overcast", "ambient.illuminance_lux=79", "exposure.white_cd_m2=25"),
    ),
    "overcast": Weather(
        light=_CLOUDS,
        light_sets=("ambient.preset=overcast", "headlights.on=off", "lights.street=off", "lights.vehicles=off"),
    ),
    # Just before sunrise.
    "dawn": Weather(
        light_sets=("ambient.preset=dawn", "ambient.sun_altitude_deg=-1", "exposure.ev=-1"),
        hour=True,
    ),
    "dusk": Weather(light_sets=("ambient.preset=blue_hour",), hour=True),
    "night": Weather(
        light=("ambient", "night_grade", "spot_lights", "harmonize"),
        light_sets=("ambient.preset=midnight",),
        hour=True,
    ),
}
JOIN = "+"  # between the weathers of a combination


def nearest(word: str, known: Iterable[str]) -> str:
    """The known name most like a mistyped one, and the choices, to end an error with."""
    names = sorted(known)
    close = difflib.get_close_matches(word, names, n=1, cutoff=0.4)
    return (f"; did you mean {close[0]}?" if close else "") + f" (known: {', '.join(names)})"


def parts(name: str) -> list[str]:
    """The weathers that a name or a combination, "rain+night", names, in the order of the table.

    Raises
    ------
    InputError
        One is unknown (the nearest is suggested) or named twice, or two are times of the day.
    """
    named = [part.strip() for part in name.split(JOIN)]
    for part in named:
        if part not in WEATHERS:
            raise InputError(f"--weather: expected a known weather, got {part!r}{nearest(part, WEATHERS)}")
        if named.count(part) > 1:
            raise InputError(f"--weather: expected every weather once, got {part!r} {named.count(part)} times")
    if len(hours := [part for part in named if WEATHERS[part].hour]) > 1:
        raise InputError(f"--weather: expected one time of the day, got {' and '.join(hours)}")
    return [part for part in WEATHERS if part in named]


def find(name: str) -> Weather:
    """A weather by name, or a combination as one weather; whatever the order in which its parts are named.

    Raises
    ------
    InputError
        See `parts`.
    """
    together = [WEATHERS[part] for part in parts(name)]
    lit_by = min(together, key=lambda weather: (not weather.hour, bool(weather.passes)))
    passes = {*lit_by.light, *(name for weather in together for name in weather.passes)}
    return Weather(
        passes=tuple(name for name in ORDER if name in passes),
        sets=(*lit_by.light_sets, *(text for weather in together for text in weather.sets)),
        light=lit_by.light,
        light_sets=lit_by.light_sets,
    )


def _switch(text: str) -> bool:
    return {"on": True, "true": True, "1": True, "off": False, "false": False, "0": False}[text.lower()]


def _rgb(text: str) -> RGB:
    red, green, blue = (float(part) for part in text.split(","))
    return red, green, blue


_READERS: dict[Any, tuple[Callable[[str], Any], str]] = {
    float: (float, "a number"),
    float | None: (float, "a number"),
    int: (int, "an integer"),
    int | None: (int, "an integer"),
    bool: (_switch, "on or off"),
    RGB: (_rgb, "three numbers R,G,B"),
    RGB | None: (_rgb, "three numbers R,G,B"),
}


def _assignment(text: str) -> tuple[str, str, Any]:
    """Group, field and value of one `group.field=value`."""
    key, equals, value = text.partition("=")
    group, dot, name = key.strip().partition(".")
    if not (equals and dot):
        raise InputError(f"--set: expected group.field=value, got {text!r}")
    keys = {f"{g}.{f.name}" for g, params in GROUPS.items() for f in dataclasses.fields(params)}
    if f"{group}.{name}" not in keys:
        raise InputError(f"--set: unknown key {key!r}{nearest(key, keys)}")
    kind = typing.get_type_hints(GROUPS[group])[name]
    read, expected = _READERS.get(kind, (str, "text"))
    try:
        return group, name, read(value.strip())
    except (ValueError, KeyError):
        raise InputError(f"--set {key}: expected {expected}, got {value!r}") from None


# Groups that stand for a whole weather: what they imply for the passes counts where those are not given.
_AMOUNTS: dict[str, type[RainParams] | type[SnowParams]] = {"snow": SnowParams, "rain": RainParams}
# Fields that say the same thing: one that is given puts the weather's own other one out of force.
_RIVALS = {("fog", "sigma_s"): "visibility_m"}


def _assigned(assignments: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Values by group and field; of several for one field the last counts."""
    out: dict[str, dict[str, Any]] = {group: {} for group in GROUPS}
    for group, name, value in map(_assignment, assignments):
        out[group][name] = value
    return out


def _made(group: str, given: dict[str, Any]) -> Any:
    try:
        return GROUPS[group](**given)
    except InputError as error:
        raise InputError(f"--set {group}.{error}") from None


def settings(weather: str, assignments: Sequence[str] = (), quality: str = DEFAULT_QUALITY) -> Settings:
    """All parameters of a weather: `group.field=value` assignments over its own, over those of a quality.

    Raises
    ------
    InputError
        The weather, the quality or a key is unknown (the nearest is suggested), or a value cannot be read or is out of
        range.
    """
    preset, given = _assigned((*quality_sets(quality), *find(weather).sets)), _assigned(assignments)
    for (group, name), rival in _RIVALS.items():
        if name in given[group]:
            preset[group].pop(rival, None)
    amounts = {group: _made(group, given[group]) for group in _AMOUNTS}
    implied = [amounts[group].implied() for group in _AMOUNTS if group in parts(weather)]
    return Settings(**{g: _made(g, _most(implied, g) | preset[g] | given[g]) for g in GROUPS})


def _most(implied: Sequence[dict[str, dict[str, Any]]], group: str) -> dict[str, Any]:
    """What several amounts imply for a group: of two values for one field the larger."""
    out: dict[str, Any] = {}
    for fields in implied:
        for name, value in fields.get(group, {}).items():
            out[name] = max(value, out.get(name, value))
    return out
