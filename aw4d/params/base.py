"""What a parameter is: a documented field with unit, range and source, and the check that every group shares."""

from __future__ import annotations

import dataclasses
import math
import typing
from dataclasses import dataclass
from typing import Any, Literal

from aw4d.errors import InputError

RGB = tuple[float, float, float]
CONVENTIONS = ("physical", "paper")


def param(
    default: Any,
    unit: str,
    meaning: str,
    source: str,
    *,
    low: float = -math.inf,
    high: float = math.inf,
    host: bool = False,
) -> Any:
    """One documented field: closed range [low, high]; `host` fields configure the run and do not reach a kernel."""
    about = {"unit": unit, "meaning": meaning, "source": source, "low": low, "high": high, "host": host}
    return dataclasses.field(default=default, metadata=about)


def _choices(params: type[Params]) -> dict[str, tuple[str, ...]]:
    """What the fields may be that are one of several words."""
    kinds = typing.get_type_hints(params).items()
    return {name: typing.get_args(kind) for name, kind in kinds if typing.get_origin(kind) is Literal}


@dataclass(frozen=True, kw_only=True)
class Params:
    """Base of all parameters: checks every field against its documented range.

    Raises
    ------
    InputError
        A number is not finite or out of range, or a word is none of the field's; the message names the field, what was
        expected and what came.
    """

    def __post_init__(self) -> None:
        for name, words in _choices(type(self)).items():
            if getattr(self, name) not in words:
                raise InputError(f"{name}: expected {' or '.join(words)}, got {getattr(self, name)!r}")
        for field in dataclasses.fields(self):
            low, high = field.metadata["low"], field.metadata["high"]
            value = getattr(self, field.name)
            for number in value if isinstance(value, tuple) else (value,):
                if isinstance(number, (int, float)) and not (math.isfinite(number) and low <= number <= high):
                    raise InputError(
                        f"{field.name}: expected {field.metadata['meaning']} in [{low:g}, {high:g}] "
                        f"{field.metadata['unit']}, got {value}"
                    )

    def arguments(self) -> dict[str, Any]:
        """Fields that the pass takes as arguments, by name."""
        return {f.name: getattr(self, f.name) for f in dataclasses.fields(self) if not f.metadata["host"]}
