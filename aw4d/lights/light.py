"""A light source, and the arrays in which a set of lights reaches the passes."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from aw4d.camera import Camera
from aw4d.errors import InputError

KINDS = ("directional", "point", "spot")
Vector = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Light:
    """One light.

    Parameters
    ----------
    kind
        "directional", "point" or "spot".
    position
        [m]; of no meaning for a directional light.
    direction
        The way the light travels; any length but 0; of no meaning for a point.
    intensity
        Linear RGB: radiant intensity of points and spots, irradiance of directional lights, on the image's scale (a
        white diffuser under irradiance pi shows as 1).
    inner_deg, outer_deg
        A spot's half angles: full brightness, darkness [deg].
    r_max_m
        Reach [m].
    frame
        "world": position and direction are world coordinates; "camera": they move with the camera (OpenCV axes).
    name
        By which it can be switched off, for example "street-3", "vehicle-12-head-left", "ego-left", "file-1".

    Raises
    ------
    InputError
        A number is not finite, a direction is zero, an intensity negative, or not 0 < inner < outer < 90 degrees.
    """

    kind: Literal["directional", "point", "spot"]
    position: Vector = (0.0, 0.0, 0.0)
    direction: Vector = (0.0, -1.0, 0.0)
    intensity: Vector = (1.0, 1.0, 1.0)
    inner_deg: float = 15.0
    outer_deg: float = 35.0
    r_max_m: float = 20.0
    frame: Literal["world", "camera"] = "world"
    name: str = ""

    def __post_init__(self) -> None:
        if self.kind not in KINDS or self.frame not in ("world", "camera"):
            raise InputError(f"light: expected kind in {KINDS}, frame world or camera, got {self.kind}, {self.frame}")
        for name in ("position", "direction", "intensity"):
            value = getattr(self, name)
            if len(value) != 3 or not np.isfinite(value).all():
                raise InputError(f"light {name}: expected three finite numbers, got {value}")
        if min(self.intensity) < 0:
            raise InputError(f"light intensity: expected >= 0, got {self.intensity}")
        if not np.linalg.norm(self.direction) > 0:
            raise InputError(f"light direction: expected a vector that is not zero, got {self.direction}")
        if self.kind == "spot" and not 0 < self.inner_deg < self.outer_deg < 90:
            raise InputError(
                f"spot cone: expected half angles 0 < inner < outer < 90 deg, got {self.inner_deg}, {self.outer_deg}"
            )
        if not 0 < self.r_max_m < 1e9:
            raise InputError(f"light r_max_m: expected a reach in (0, 1e9) m, got {self.r_max_m}")


@dataclass(frozen=True, kw_only=True, eq=False)
class LightArrays:
    """Lights in one frame's camera coordinates, one row a light, by the names that every pass takes."""

    light_kind: NDArray[np.int32]
    light_position: NDArray[np.float32]
    light_direction: NDArray[np.float32]
    light_intensity: NDArray[np.float32]
    light_cos_inner: NDArray[np.float32]
    light_cos_outer: NDArray[np.float32]
    light_r_max: NDArray[np.float32]
    light_air_floor: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.light_kind)


def in_camera(lights: Sequence[Light], camera: Camera) -> LightArrays:
    """Arrays of the lights as the camera sees them; world coordinates are subtracted in float64 first."""
    n = len(lights)
    position, direction = np.zeros((n, 3)), np.zeros((n, 3))
    for i, light in enumerate(lights):
        position[i] = light.position
        direction[i] = np.asarray(light.direction) / np.linalg.norm(light.direction)
        if light.frame == "world":
            position[i] = camera.to_camera(position[i])
            direction[i] = direction[i] @ camera.camera_to_world[:3, :3]
    return LightArrays(
        light_kind=np.array([KINDS.index(light.kind) for light in lights], dtype=np.int32),
        light_position=position.astype(np.float32),
        light_direction=direction.astype(np.float32),
        light_intensity=np.array([light.intensity for light in lights], dtype=np.float32).reshape(n, 3),
        light_cos_inner=np.cos(np.radians([light.inner_deg for light in lights])).astype(np.float32),
        light_cos_outer=np.cos(np.radians([light.outer_deg for light in lights])).astype(np.float32),
        light_r_max=np.array([light.r_max_m for light in lights], dtype=np.float32),
        light_air_floor=np.zeros(n, dtype=np.float32),
    )


def balls(lights: LightArrays) -> NDArray[np.float32]:
    """Balls (x, y, z, radius) that hold all that each light can reach, (L, 4), camera frame [m].

    A spot's is that of its cone capped by its reach, a point's its reach, a directional light's without end.
    """
    reach = lights.light_r_max.astype(np.float64)
    spot = lights.light_kind == KINDS.index("spot")
    cos = np.where(spot, lights.light_cos_outer, -1.0).astype(np.float64)
    narrow, wide = cos > np.sqrt(0.5), (cos > 0) & (cos <= np.sqrt(0.5))
    # A cone under 45 degrees fits the ball through its apex and its rim, a wider one the ball around its rim.
    offset = np.where(narrow, reach / (2 * np.maximum(cos, 0.5)), np.where(wide, reach * cos, 0.0))
    radius = np.where(narrow, offset, np.where(wide, reach * np.sqrt(np.maximum(1 - cos**2, 0)), reach))
    radius[lights.light_kind == KINDS.index("directional")] = np.inf
    centre = lights.light_position + offset[:, None] * lights.light_direction
    return np.concatenate([centre, radius[:, None]], axis=1).astype(np.float32)


def shapes(lights: LightArrays) -> NDArray[np.float32]:
    """What a kernel needs of each light's cone and reach, so that no pixel divides for it, (L, 4).

    Cosine of the outer angle (-1 for no cone), its sine squared, 1 / (cos_inner - cos_outer), 1 / reach [1/m].
    """
    inner, outer, reach = (
        array.astype(np.float64) for array in (lights.light_cos_inner, lights.light_cos_outer, lights.light_r_max)
    )
    cone = np.where(lights.light_kind == KINDS.index("spot"), outer, -1.0)
    return np.stack([cone, 1 - cone**2, 1 / (inner - outer), 1 / reach], axis=1).astype(np.float32)


def switched_on(lights: Sequence[Light], off: str) -> list[Light]:
    """Lights that are left with some switched off: ids with commas, each a light's name or the start of names.

    "vehicle-12" stands for all lights of that vehicle, "street" for all street lamps.
    """
    stems = [stem.strip() for stem in off.split(",") if stem.strip()]
    return [light for light in lights if not any(f"{light.name}-".startswith(f"{stem}-") for stem in stems)]


def read_lights(path: str | Path) -> list[Light]:
    """Lights of a JSON file: a list of objects with the fields of `Light`.

    Raises
    ------
    InputError
        The file cannot be read, is no such list, or an entry is wrong; the message names file and entry.
    """
    try:
        entries: Any = json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: expected a JSON list of lights ({error})") from error
    if not isinstance(entries, list):
        raise InputError(f"{path}: expected a JSON list of lights, got {type(entries).__name__}")
    lights = []
    for i, entry in enumerate(entries):
        try:
            light = _light(entry)
        except InputError as error:
            raise InputError(f"{path}: light {i}: {error}") from error
        lights.append(light if light.name else replace(light, name=f"file-{i + 1}"))
    return lights


def _light(entry: Any) -> Light:
    """A light of a JSON object; every field has the type that its default has."""
    if not isinstance(entry, dict) or "kind" not in entry:
        raise InputError(f"expected an object with a kind, got {entry!r}")
    known = {field.name: field.default for field in fields(Light)}
    for name, value in entry.items():
        if name not in known:
            raise InputError(f"expected the fields {', '.join(known)}, got {name!r}")
        numbers = value if isinstance(value, list) else [value]
        text = name in ("kind", "frame", "name")
        vector = isinstance(known[name], tuple)
        if isinstance(value, list) != vector or not all(isinstance(v, str if text else (int, float)) for v in numbers):
            expected = "text" if text else "three numbers" if vector else "a number"
            raise InputError(f"{name}: expected {expected}, got {value!r}")
    values: dict[str, Any] = {name: tuple(value) if isinstance(value, list) else value for name, value in entry.items()}
    return Light(**values)
