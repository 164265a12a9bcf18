"""Parameters of the light of the surroundings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from aw4d.params.base import Params, param

PresetName = Literal["noon", "golden_hour", "dawn", "blue_hour", "overcast", "midnight"]


@dataclass(frozen=True, kw_only=True)
class AmbientParams(Params):
    """Sky, ground and sun. Paper, "Environment"."""

    preset: PresetName = param("overcast", "", "the time of the day", "docs/ambient.md", host=True)
    map: str = param("", "", "an environment map, .hdr or .exr, in place of the preset's sky", "", host=True)
    frames: str = param("", "", "a folder of frames that a neural renderer made of the ambient light", "", host=True)
    sun_altitude_deg: float | None = param(
        None, "deg", "the sun's height above the horizon (default: the preset's)", "", low=-18, high=90, host=True
    )
    sun_azimuth_deg: float | None = param(
        None,
        "deg",
        "the sun's place, clockwise from world -z (default: the preset's)",
        "",
        low=-360,
        high=360,
        host=True,
    )
    turbidity: float | None = param(
        None,
        "1",
        "the haze of a clear sky (default: the preset's)",
        "Preetham et al. 1999",
        low=1.9,
        high=10,
        host=True,
    )
    illuminance_lux: float | None = param(
        None, "lux", "the light on a level surface (default: the preset's)", "", low=0, high=2e5, host=True
    )
    rotation_deg: float = param(
        0.0, "deg", "how far the surroundings are turned clockwise", "", low=-360, high=360, host=True
    )
    strength: float = param(1.0, "1", "a factor on all of it", "", low=0, high=1e3, host=True)
    shadow_steps: int = param(80, "1", "the samples of a ray to the sun", "docs/ambient.md", low=0, high=1024)
    shadow_distance_m: float = param(40.0, "m", "how far a shadow is cast", "", low=0.1, high=1e4)
    thickness_m: float = param(
        0.7, "m", "how far things reach behind what is seen of them", "docs/ambient.md", low=0.01, high=100
    )
    occlusion_radius_m: float = param(1.5, "m", "how near things occlude the surroundings", "", low=0.01, high=100)
    occlusion_slices: int = param(4, "1", "the slices of the half space", "Jimenez et al. 2016", low=1, high=8)
    occlusion_steps: int = param(7, "1", "the samples on each side of a slice", "docs/ambient.md", low=0, high=9)
