"""Parameters of the camera's exposure."""

from __future__ import annotations

from dataclasses import dataclass

from aw4d.params.base import Params, param


@dataclass(frozen=True, kw_only=True)
class ExposureParams(Params):
    """How bright a luminance shows. By default metered: a white card on the ground shows as white."""

    white_cd_m2: float | None = param(
        None, "cd/m2", "the luminance that shows as white", "docs/light.md", low=1e-3, high=1e6, host=True
    )
    ev: float = param(0.0, "stops", "the compensation of the metered exposure", "", low=-10, high=10, host=True)
    darkest_white_cd_m2: float = param(
        25.0, "cd/m2", "the least white that the camera's gain reaches", "docs/light.md", low=1e-3, high=1e6, host=True
    )
