"""Weathers by name: which passes they run, and how `--set group.field=value` reaches their parameters."""

from __future__ import annotations

import dataclasses
import difflib
import typing
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from aw4d.errors import InputError
from aw4d.params import (
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
    SpotLightsParams,
    StreetLampParams,
    VehicleLightParams,
)


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
    spot_lights: SpotLightsParams = field(default_factory=SpotLightsParams)
    street_lamps: StreetLampParams = field(default_factory=StreetLampParams)
    vehicle_lights: VehicleLightParams = field(default_factory=VehicleLightParams)


GROUPS: dict[str, type[Params]] = typing.get_type_hints(Settings)


@dataclass(frozen=True, kw_only=True)
class Weather:
    """A named weather: what it is for people, its passes in order, and what it sets other than the defaults."""

    about: str
    passes: tuple[str, ...]
    sets: tuple[str, ...]


_RELIT = ("ambient", "spot_lights", "harmonize")
_BY_DAY = ("headlights.on=off", "lights.street=off", "lights.vehicles=off")

WEATHERS: dict[str, Weather] = {
    "fog": Weather(
        about="dense fog in deep dusk, headlights on",
        passes=(*_RELIT, "fog"),
        sets=("ambient.preset=overcast", "ambient.illuminance_lux=79", "exposure.white_cd_m2=25"),
    ),
    "overcast": Weather(
        about="a grey day without shadows",
        passes=("ambient", "overcast_sky", "spot_lights", "harmonize"),
        sets=("ambient.preset=overcast", *_BY_DAY),
    ),
    "dawn": Weather(
        about="just before sunrise",
        passes=_RELIT,
        sets=("ambient.preset=dawn", "ambient.sun_altitude_deg=-1", "exposure.ev=-1"),
    ),
    "dusk": Weather(about="the blue hour, lights on", passes=_RELIT, sets=("ambient.preset=blue_hour",)),
    "night": Weather(
        about="midnight: lamps, headlights, a faint sky",
        # The night's grading is for what no lamp lights (paper, "Nocturnal Local Relighting"): lamps keep their colour.
        passes=("ambient", "night_grade", "spot_lights", "harmonize"),
        sets=("ambient.preset=midnight",),
    ),
}


def nearest(word: str, known: Iterable[str]) -> str:
    """The known name most like a mistyped one, and the choices, to end an error with."""
    names = sorted(known)
    close = difflib.get_close_matches(word, names, n=1, cutoff=0.4)
    return (f"; did you mean {close[0]}?" if close else "") + f" (known: {', '.join(names)})"


def find(name: str) -> Weather:
    """A weather by name.

    Raises
    ------
    InputError
        There is none of that name; the message suggests the nearest.
    """
    if name not in WEATHERS:
        raise InputError(f"--weather: expected a known weather, got {name!r}{nearest(name, WEATHERS)}")
    return WEATHERS[name]


def _switch(text: str) -> bool:
    return {"on": True, "true": True, "1": True, "off": False, "false": False, "0": False}[text.lower()]


def _rgb(text: str) -> RGB:
    red, green, blue = (float(part) for part in text.split(","))
    return red, green, blue


_READERS: dict[Any, tuple[Callable[[str], Any], str]] = {
    float: (float, "a number"),
    float | None: (float, "a number"),
    int: (int, "an integer"),
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


def settings(weather: str, assignments: Sequence[str] = ()) -> Settings:
    """All parameters of a weather, with `group.field=value` assignments over its own.

    Raises
    ------
    InputError
        The weather or a key is unknown (the nearest is suggested), or a value cannot be read or is out of range.
    """
    given: dict[str, dict[str, Any]] = {group: {} for group in GROUPS}
    for text in (*find(weather).sets, *assignments):
        group, name, value = _assignment(text)
        given[group][name] = value
    made: dict[str, Any] = {}
    for group, params in GROUPS.items():
        try:
            made[group] = params(**given[group])
        except InputError as error:
            raise InputError(f"--set {group}.{error}") from None
    return Settings(**made)
