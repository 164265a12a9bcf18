"""Parameters of the snow that lies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from aw4d.errors import InputError
from aw4d.params.base import RGB, Params, param

STRAY = 0.3  # standard deviation of the metaballs' sum over its mean
_FRESH: dict[str, Any] = {"snow_albedo": (0.87, 0.89, 0.92), "snow_roughness": 1.0}
_PRINTED: dict[str, Any] = {"snow_albedo": (1.0, 1.0, 1.0), "snow_roughness": 0.6}


@dataclass(frozen=True, kw_only=True)
class SnowCoverParams(Params):
    """Snow on the ground and on vehicles. Paper, supplement "Metaball-based surface snow", "Material blending"."""

    depth_cm: float = param(5.0, "cm", "the mean depth of the snow on level ground", "", low=0, high=200)
    relief_cm: float = param(
        1.5, "cm", "the standard deviation of the depth that deep snow keeps", "", low=0, high=100, host=True
    )
    cover_cm: float = param(1.0, "cm", "the depth that hides 1 - 1/e of the ground", "", low=0.01, high=100)
    gamma: float = param(0.9, "1", "the exponent on the coverage", "paper", low=0.1, high=4)
    flat_deg: float = param(30.0, "deg", "the slope up to which all snow stays", "", low=0, high=88, host=True)
    steep_deg: float = param(
        55.0, "deg", "the slope from which on none stays", "avalanche slopes", low=1, high=89, host=True
    )
    max_slope: float = param(0.6, "1", "the steepest bump of the snow", "paper: clamped", low=0.01, high=10)
    snow_albedo: RGB | None = param(
        None, "linear", "the snow's albedo (physical: fresh snow, paper: 1)", "Wiscombe and Warren 1980", low=0, high=1
    )
    snow_roughness: float | None = param(
        None, "1", "the snow's roughness (physical: 1, paper: 0.6)", "snow is diffuse", low=0, high=1
    )
    road_share: float = param(0.5, "1", "the share of the snow that lies on the road", "", low=0, high=1)
    road_bare: float = param(0.9, "1", "how much less of it lies in the road's barest spots", "", low=0, high=1)
    track_gauge_m: float = param(1.6, "m", "the distance between a vehicle's ruts", "", low=0.5, high=3)
    track_width_m: float = param(0.35, "m", "the width of a rut", "", low=0.05, high=1)
    track_share: float = param(0.1, "1", "the share of the road's snow that is left in the ruts", "", low=0, high=1)
    track_middle: float = param(0.6, "1", "the share that is left between the ruts", "", low=0, high=1)
    vehicle_share: float = param(
        0.6, "1", "the share of the snow that a vehicle which drives carries", "", low=0, high=1, host=True
    )
    displacement: bool = param(False, "", "whether the surface rises by the snow's height", "paper: optional")
    convention: Literal["physical", "paper"] = param("physical", "", "the formulas: physical or paper", "docs/paper.md")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.steep_deg < self.flat_deg + 1:
            raise InputError(
                f"steep_deg: expected at least 1 deg more than flat_deg = {self.flat_deg:g}, got {self.steep_deg:g}"
            )
        for name, value in (_PRINTED if self.convention == "paper" else _FRESH).items():
            if getattr(self, name) is None:
                object.__setattr__(self, name, value)

    def arguments(self) -> dict[str, Any]:
        """Fields by name; the slopes by the upward component of their normals, the relief by the bumps' share."""
        # Rounded once, so that every backend has the same limits.
        flat, steep = (float(np.float32(np.cos(np.radians(deg)))) for deg in (self.flat_deg, self.steep_deg))
        stray = STRAY * self.depth_cm
        bumps = 1.0 if self.convention == "paper" or stray <= self.relief_cm else self.relief_cm / stray
        return super().arguments() | {"up_flat": flat, "up_steep": steep, "bumps": float(np.float32(bumps))}
