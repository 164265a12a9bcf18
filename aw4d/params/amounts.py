"""How much falls: rain and snow in the units of a weather service, from which the passes' own parameters follow."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from aw4d.params.base import Params, param

Amount = Literal["light", "moderate", "heavy"]

RAIN = {"light": 2.0, "moderate": 6.0, "heavy": 25.0}  # [mm/h]; moderate is 2.5 to 7.6 (AMS glossary)
SNOW = {"light": (1.0, 0.5), "moderate": (5.0, 1.5), "heavy": (15.0, 4.0)}  # [cm] on the ground, [mm/h] of water
# What a rate brings along: share of the road under puddles, wetness of what lies open. Rain that has lasted a while.
RATES = (0.0, 2.0, 6.0, 25.0, 100.0)  # [mm/h]
PUDDLES = (0.0, 0.08, 0.2, 0.35, 0.5)
WETNESS = (0.0, 0.5, 0.7, 0.85, 0.9)
SLUSH = 0.5  # wetness of what the snow leaves bare


@dataclass(frozen=True, kw_only=True)
class RainParams(Params):
    """Rain as a whole; what a pass is given by itself counts before it."""

    amount: Amount = param("moderate", "", "how much it rains: light, moderate or heavy", "AMS", host=True)
    rate_mm_h: float | None = param(
        None, "mm/h", "the water that falls (default: 2, 6 or 25 by the amount)", "AMS", low=0, high=300, host=True
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.rate_mm_h is None:
            object.__setattr__(self, "rate_mm_h", RAIN[self.amount])

    def implied(self) -> dict[str, dict[str, Any]]:
        """Parameters of the passes that follow, by group and field."""
        rate = self.rate_mm_h
        assert rate is not None  # set by __post_init__
        return {
            "rain_streaks": {"rate_mm_h": rate},
            "ripples": {"rate_mm_h": rate},
            "puddles": {"share": float(np.interp(rate, RATES, PUDDLES))},
            "wet_ground": {"wetness": float(np.interp(rate, RATES, WETNESS))},
        }


@dataclass(frozen=True, kw_only=True)
class SnowParams(Params):
    """Snow as a whole; what a pass is given by itself counts before it."""

    amount: Amount = param("moderate", "", "how much snow there is: light, moderate or heavy", "", host=True)
    depth_cm: float | None = param(
        None, "cm", "the snow on level ground (default: 1, 5 or 15 by the amount)", "", low=0, high=200, host=True
    )
    rate_mm_h: float | None = param(
        None, "mm/h", "the water that falls as snow (default: 0.5, 1.5 or 4)", "", low=0, high=50, host=True
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        depth_cm, rate_mm_h = SNOW[self.amount]
        if self.depth_cm is None:
            object.__setattr__(self, "depth_cm", depth_cm)
        if self.rate_mm_h is None:
            object.__setattr__(self, "rate_mm_h", rate_mm_h)

    def implied(self) -> dict[str, dict[str, Any]]:
        """Parameters of the passes that follow, by group and field."""
        return {
            "snow_cover": {"depth_cm": self.depth_cm},
            "snow_fall": {"rate_mm_h": self.rate_mm_h},
            "wet_ground": {"wetness": SLUSH},
        }
