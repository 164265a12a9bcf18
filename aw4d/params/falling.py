"""Parameters of what falls through the air: streaks of rain, flakes of snow."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from aw4d.params.base import RGB, Params, param

MOST = 1_000_000  # particles a pass


@dataclass(frozen=True, kw_only=True)
class RainStreaksParams(Params):
    """Drops near the camera. Paper, supplement "Precipitation Dynamics" and "Material Response Parameters".

    After construction `drops` and `opacity` are filled in.
    """

    rate_mm_h: float = param(
        6.0, "mm/h", "the water that falls, which sets number and sizes of the drops", "", low=0, high=300, host=True
    )
    drops: int | None = param(
        None,
        "1",
        "the largest number of drops in the box around the view (physical: 30000, paper: 10000)",
        "paper",
        low=0,
        high=MOST,
        host=True,
    )
    reach_m: float = param(10.0, "m", "the distance up to which the largest drops are drawn", "", low=0.1, high=1e3)
    near_m: float = param(0.4, "m", "the depth nearer than which nothing is drawn", "", low=0.01, high=100)
    exposure_s: float = param(0.01, "s", "the time for which the shutter is open", "", low=0, high=1, host=True)
    wind_m_s: RGB = param(
        (0.1, 0.0, 0.0), "m/s", "the wind along the world's x, y and z", "paper", low=-100, high=100, host=True
    )
    gust_m_s: float = param(
        0.5, "m/s", "the standard deviation of the drops' speed along x and z", "paper", low=0, high=50, host=True
    )
    opacity: float | None = param(
        None, "1", "the strength of the streaks (physical: 4, paper: 0.4; 1 is a drop's own)", "paper", low=0, high=100
    )
    g: float = param(0.85, "1", "the mean cosine of the angle by which a drop turns light", "", low=-0.999, high=0.999)
    aperture_mm: float = param(2.0, "mm", "the width of the lens' opening", "", low=0, high=100)
    focus_m: float = param(20.0, "m", "the depth that is in focus", "", low=0.1, high=1e6)
    seed: int = param(1, "1", "the number that the drops' places are drawn by", "", low=0, high=2**31 - 1)
    convention: Literal["physical", "paper"] = param("physical", "", "the formulas: physical or paper", "docs/paper.md")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.drops is None:
            object.__setattr__(self, "drops", 10_000 if self.convention == "paper" else 30_000)
        if self.opacity is None:
            object.__setattr__(self, "opacity", 0.4 if self.convention == "paper" else 4.0)


@dataclass(frozen=True, kw_only=True)
class SnowFallParams(Params):
    """Flakes near the camera. Paper, supplement "Particle-based falling snow".

    After construction `flakes`, `gust_m_s` and `flutter_m` are filled in.
    """

    rate_mm_h: float = param(
        1.5, "mm/h", "the water that falls, which sets number and sizes of the flakes", "", low=0, high=50, host=True
    )
    flakes: int | None = param(
        None,
        "1",
        "the largest number of flakes in the box around the view (physical: 30000, paper: 6000)",
        "paper",
        low=0,
        high=MOST,
        host=True,
    )
    reach_m: float = param(20.0, "m", "the distance up to which the largest flakes are drawn", "", low=0.1, high=1e3)
    near_m: float = param(0.4, "m", "the depth nearer than which nothing is drawn", "", low=0.01, high=100)
    exposure_s: float = param(0.004, "s", "the time for which the shutter is open", "", low=0, high=1, host=True)
    wind_m_s: RGB = param(
        (0.3, 0.0, 0.1), "m/s", "the wind along the world's x, y and z", "paper", low=-100, high=100, host=True
    )
    gust_m_s: float | None = param(
        None,
        "m/s",
        "the standard deviation of the flakes' speed along x and z (physical: 0.2, paper: 0)",
        "",
        low=0,
        high=50,
        host=True,
    )
    flutter_m: float | None = param(
        None, "m", "how far a flake sways to either side (physical: 0.03, paper: 0)", "", low=0, high=10, host=True
    )
    opacity: float = param(1.0, "1", "the strength of the flakes", "", low=0, high=100)
    g: float = param(0.5, "1", "the mean cosine of the angle by which a flake turns light", "", low=-0.999, high=0.999)
    aperture_mm: float = param(2.0, "mm", "the width of the lens' opening", "", low=0, high=100)
    focus_m: float = param(20.0, "m", "the depth that is in focus", "", low=0.1, high=1e6)
    seed: int = param(2, "1", "the number that the flakes' places are drawn by", "", low=0, high=2**31 - 1)
    convention: Literal["physical", "paper"] = param("physical", "", "the formulas: physical or paper", "docs/paper.md")

    def __post_init__(self) -> None:
        super().__post_init__()
        paper = self.convention == "paper"
        if self.flakes is None:
            object.__setattr__(self, "flakes", 6_000 if paper else 30_000)
        if self.gust_m_s is None:
            object.__setattr__(self, "gust_m_s", 0.0 if paper else 0.2)
        if self.flutter_m is None:
            object.__setattr__(self, "flutter_m", 0.0 if paper else 0.03)
