"""Weathers by name: which passes they run, and how `--set group.field=value` reaches their parameters."""

from __future__ import annotations

import dataclasses
import difflib
import typing
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from aw4d.errors import InputError
from aw4d.params import RGB, FogParams, HeadlightParams, LightParams, Params


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Parameters of everything that an edit can run."""

    fog: FogParams = dataclasses.field(default_factory=FogParams)
    headlights: HeadlightParams = dataclasses.field(default_factory=HeadlightParams)
    lights: LightParams = dataclasses.field(default_factory=LightParams)


@dataclass(frozen=True, kw_only=True)
class Weather:
    """A named weather: its passes in order."""

    passes: tuple[str, ...]


WEATHERS: dict[str, Weather] = {"fog": Weather(passes=("fog",))}
GROUPS: dict[str, type[Params]] = {"fog": FogParams, "headlights": HeadlightParams, "lights": LightParams}


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


def settings(assignments: Sequence[str] = ()) -> Settings:
    """All parameters, with `group.field=value` assignments over their defaults.

    Raises
    ------
    InputError
        A key is unknown (the nearest is suggested), or a value cannot be read or is out of range.
    """
    given: dict[str, dict[str, Any]] = {group: {} for group in GROUPS}
    for text in assignments:
        group, name, value = _assignment(text)
        given[group][name] = value
    try:
        return Settings(
            fog=FogParams(**given["fog"]),
            headlights=HeadlightParams(**given["headlights"]),
            lights=LightParams(**given["lights"]),
        )
    except InputError as error:
        raise InputError(f"--set: {error}") from None
