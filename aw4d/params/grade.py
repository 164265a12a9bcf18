"""Parameters of the light passes that look at no geometry: fusion of the lights, overcast sky, night grading."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from aw4d.errors import InputError
from aw4d.params.base import RGB, Params, param


@dataclass(frozen=True, kw_only=True)
class HarmonizeParams(Params):
    """Fusion of the ambient light with that of the local lamps. Paper, supplement "Environment Harmonization"."""

    strength: float | None = param(
        None, "1", "how much lamps replace the ambient light (physical: 0, paper: 1)", "paper", low=0, high=1e3
    )
    threshold: float = param(0.05, "linear", "the lamps' mean radiance below which nothing is replaced", "paper", low=0)
    convention: Literal["physical", "paper"] = param("physical", "", "the formulas: physical or paper", "docs/paper.md")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.strength is None:
            object.__setattr__(self, "strength", 1.0 if self.convention == "paper" else 0.0)


@dataclass(frozen=True, kw_only=True)
class OvercastSkyParams(Params):
    """The sky under clouds. Paper, supplement "Atmospheric Effects"."""

    tint: RGB = param((0.55, 0.60, 0.70), "linear", "the clouds' colour, not all of it 0", "paper", low=0, high=1e3)
    amount: float = param(0.6, "1", "the share of the tint", "paper", low=0, high=1)
    desaturation: float = param(0.7, "1", "the share of its colour that the sky loses", "paper", low=0, high=1)
    convention: Literal["physical", "paper"] = param("physical", "", "the formulas: physical or paper", "docs/paper.md")

    def __post_init__(self) -> None:
        super().__post_init__()
        if max(self.tint) <= 0:
            raise InputError(f"tint: expected a colour with light in it, got {self.tint}")


@dataclass(frozen=True, kw_only=True)
class NightGradeParams(Params):
    """Tone and colour of the night. Paper, supplement "LUT Construction for Global Tone Mapping".

    `sky_dilate_px` and `sky_blur_px` are pixels of a picture of 704 rows, so that the look does not depend on the
    resolution; under "paper" they are pixels as they are.
    """

    strength: float = param(1.0, "1", "the strength of the night", "paper", low=0, high=1)
    percentile: int = param(
        70, "%", "the share of pixels up to the luminance that sets the exposure", "paper", low=1, high=100
    )
    luminance: float | None = param(
        None, "linear", "the luminance that sets the exposure (default: each frame's own)", "", low=0, high=1e5
    )
    steady: bool = param(
        False, "", "whether the whole clip has one exposure, the median of some frames'", "", host=True
    )
    sky_factor: float = param(0.6, "1", "what is left of the sky's light", "paper", low=0, high=1)
    sky_dilate_px: int = param(20, "px", "how far the darkened sky reaches over its edge", "paper", low=0, high=64)
    sky_blur_px: int = param(10, "px", "the standard deviation of the blur of that edge", "paper", low=0, high=32)
    convention: Literal["physical", "paper"] = param("physical", "", "the formulas: physical or paper", "docs/paper.md")

    def arguments(self) -> dict[str, Any]:
        """Fields by name; a luminance of -1 asks the pass to measure it."""
        return super().arguments() | {"luminance": -1.0 if self.luminance is None else self.luminance}
