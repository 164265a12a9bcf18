"""One frame's planes and the rules that every plane must meet before it enters."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aw4d.camera import Camera
from aw4d.errors import InputError

Plane = NDArray[Any]


@dataclass(frozen=True, kw_only=True)
class PlaneSpec:
    """What a plane is: trailing channels, dtype, admitted range (closed), unit, and one line of meaning."""

    channels: int
    dtype: type
    low: float
    high: float
    unit: str
    meaning: str

    def shape(self, height: int, width: int) -> tuple[int, ...]:
        """Shape of the plane on a frame of the given size [px]."""
        return (height, width) if self.channels == 1 else (height, width, self.channels)


def _spec(channels: int, dtype: type, low: float, high: float, unit: str, meaning: str) -> PlaneSpec:
    return PlaneSpec(channels=channels, dtype=dtype, low=low, high=high, unit=unit, meaning=meaning)


DEPTH_MAX = 1e5  # [m] no surface is farther; the sky's range is a parameter of the passes, not a depth
INSTANCE_MAX = 2**15 - 1

PLANES: dict[str, PlaneSpec] = {
    "rgb": _spec(3, np.float32, 0.0, 1e5, "scene-linear Rec.709", "the recorded image, 1 = display white"),
    "depth": _spec(1, np.float32, 1e-3, DEPTH_MAX, "m", "z of the surface; sky: 99th percentile of the clip"),
    "normal": _spec(3, np.float32, -1.001, 1.001, "unit", "surface normal, camera frame, facing the camera"),
    "albedo": _spec(3, np.float32, 0.0, 1.0, "linear", "diffuse reflectance"),
    "roughness": _spec(1, np.float32, 0.0, 1.0, "1", "perceptual roughness; alpha is its square"),
    "metallic": _spec(1, np.float32, 0.0, 1.0, "1", "0 dielectric, 1 metal"),
    "emissive": _spec(3, np.float32, 0.0, 1e5, "scene-linear Rec.709", "radiance the surface sends by itself"),
    "sky": _spec(1, np.bool_, 0, 1, "mask", "nothing but sky along the ray"),
    "road": _spec(1, np.bool_, 0, 1, "mask", "drivable ground"),
    "vehicle": _spec(1, np.int32, 0, INSTANCE_MAX, "id", "vehicle instance, 0 = none"),
    "street_light": _spec(1, np.int32, 0, INSTANCE_MAX, "id", "street lamp instance, 0 = none"),
}


def _range_text(values: Plane) -> str:
    finite = values[np.isfinite(values)]
    return f"[{finite.min():g}, {finite.max():g}]" if finite.size else "no finite value"


def length2(vectors: Plane) -> Plane:
    """Squared lengths of (..., 3)."""
    x, y, z = (vectors[..., i] for i in range(3))
    out = x * x
    out += y * y
    out += z * z
    return np.asarray(out)


def check_plane(name: str, values: Plane, height: int, width: int, *, sound: bool = False) -> Plane:
    """Check one plane against its rule and return it, contiguous.

    Parameters
    ----------
    name
        A key of `PLANES`.
    values
        (height, width) or (height, width, 3) of the rule's dtype.
    height, width
        Size of the frame [px].
    sound
        The values keep the rule, whatever they are: only shape and dtype are looked at.

    Raises
    ------
    InputError
        The shape, the dtype, a NaN, an Inf, the range or the length of a normal is wrong; the message names the
        plane, what was expected and what came.
    """
    spec = PLANES.get(name)
    if spec is None:
        raise InputError(f"{name}: expected a plane out of {', '.join(PLANES)}")
    expected = f"{name}: expected {spec.shape(height, width)} {np.dtype(spec.dtype).name} in {spec.unit}"
    if values.shape != spec.shape(height, width):
        raise InputError(f"{expected}, got shape {values.shape}")
    if values.dtype != spec.dtype:
        raise InputError(f"{expected}, got {values.dtype.name}")
    if values.size and not sound:
        _check_values(spec, values, expected)
    return np.ascontiguousarray(values)


def _check_values(spec: PlaneSpec, values: Plane, expected: str) -> None:
    # A NaN among them is also the least and the largest of them, and is within no range.
    if spec.dtype is not np.bool_ and not (values.min() >= spec.low and values.max() <= spec.high):
        if spec.dtype is np.float32 and (bad := int(values.size - np.count_nonzero(np.isfinite(values)))):
            raise InputError(f"{expected}, got {bad} values that are NaN or infinite")
        raise InputError(f"{expected} within [{spec.low:g}, {spec.high:g}], got {_range_text(values)}")
    if spec is PLANES["normal"] and np.abs((found := length2(values)) - 1).max() > 4e-3:
        raise InputError(f"{expected} of length 1, got lengths {_range_text(np.sqrt(found))}")


def check_depth_unit(depth: Plane, sky: Plane | None = None) -> None:
    """Refuse a depth plane that cannot be metres on a road.

    Raises
    ------
    InputError
        The depth that is not sky is all under 1 m (normalised? kilometres?), or half of it over 1,000 m (millimetres?).
    """
    seen = depth if sky is None else depth[~sky]
    if seen.size and (seen.max() < 1 or np.median(seen) > 1_000):
        raise InputError(
            f"depth: expected metres on a road, got {_range_text(seen)}, {np.median(seen):g} in the median; "
            "say the source's unit with --depth-scale"
        )


class GBuffer(Mapping[str, Plane]):
    """One frame: its planes by name, its camera and its time.

    A mapping from plane name to array, so that a frame can hold the planes a job needs and no others.

    Parameters
    ----------
    planes
        Arrays by the names in `PLANES`; each is validated (`check_plane`).
    camera
        The frame's camera.
    time
        Seconds since the clip's first frame.
    sound
        Names of planes that keep their rule whatever their values: those are not looked at.

    Raises
    ------
    InputError
        A plane breaks its rule.
    """

    def __init__(
        self, planes: Mapping[str, Plane], *, camera: Camera, time: float, sound: frozenset[str] = frozenset()
    ) -> None:
        self.camera = camera
        self.time = float(time)
        self._planes = {
            name: check_plane(name, values, *camera.shape, sound=name in sound) for name, values in planes.items()
        }

    def with_plane(self, name: str, values: Plane) -> GBuffer:
        """The same frame with one plane more, or another one in its place; only that one is checked."""
        out = GBuffer({}, camera=self.camera, time=self.time)
        out._planes = self._planes | {name: check_plane(name, values, *self.camera.shape)}
        return out

    def only(self, names: Collection[str]) -> GBuffer:
        """The same frame with those of its planes that are named."""
        out = GBuffer({}, camera=self.camera, time=self.time)
        out._planes = {name: values for name, values in self._planes.items() if name in names}
        return out

    def __getitem__(self, name: str) -> Plane:
        try:
            return self._planes[name]
        except KeyError:
            held = ", ".join(self._planes) or "none"
            raise InputError(f"{name}: this frame has no such plane (it has: {held})") from None

    def __contains__(self, name: object) -> bool:
        return name in self._planes

    def __iter__(self) -> Iterator[str]:
        return iter(self._planes)

    def __len__(self) -> int:
        return len(self._planes)
