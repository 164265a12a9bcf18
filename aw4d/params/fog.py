"""Parameters of the fog."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from aw4d.errors import InputError
from aw4d.params.base import RGB, Params, param

KOSCHMIEDER = 3.912  # -ln(0.02): contrast left at the visibility, Koschmieder 1924
DEFAULT_VISIBILITY_M = 150.0


@dataclass(frozen=True, kw_only=True)
class FogParams(Params):
    """Fog. Give `visibility_m`, or `sigma_s` and `sigma_a`; after construction both descriptions are filled in.

    Paper, supplement "Fog modeling" and "Fog blending".
    """

    visibility_m: float | None = param(
        None, "m", "the distance at which 2 % of contrast is left", "Koschmieder 1924", low=1, high=1e9, host=True
    )
    sigma_s: float | None = param(None, "1/m", "the scattering coefficient", "paper, Fog modeling", low=0, high=10)
    sigma_a: float = param(0.0, "1/m", "the absorption coefficient", "paper, Fog modeling", low=0, high=10)
    alpha: float = param(1.0, "1", "the density factor on both", "paper, Fog modeling", low=0, high=1e3)
    g: float = param(0.8, "1", "the mean cosine of the phase function", "paper, Fog modeling", low=-0.999, high=0.999)
    gamma: float = param(1.0, "1", "the strength of the lights' in-scatter", "paper, Fog modeling", low=0, high=1e3)
    beta: float | None = param(
        None, "1", "the strength of the final blend (physical: 0, paper: 0.5)", "paper, Fog blending", low=0, high=1
    )
    color: RGB | None = param(
        None,
        "linear",
        "the fog's colour (default: the surroundings' mean radiance)",
        "paper, Fog blending",
        low=0,
        high=1e3,
    )
    nodes: int = param(8, "1", "the even number of quadrature nodes a light", "Gauss-Legendre", low=2, high=64)
    faintest: float = param(
        3e-4,
        "white",
        "the glow in the air that is too faint by day to be taken, in the dark up to 5 times fainter; 0 takes all",
        "",
        low=0,
        high=1,
        host=True,
    )
    extent_m: float = param(2e4, "m", "the longest path through the fog, also to the sky", "", low=1, high=1e5)
    convention: Literal["physical", "paper"] = param("physical", "", "the formulas: physical or paper", "docs/paper.md")

    def __post_init__(self) -> None:
        if self.nodes % 2:
            raise InputError(f"nodes: expected an even number, got {self.nodes}")
        super().__post_init__()
        if self.beta is None:
            object.__setattr__(self, "beta", 0.5 if self.convention == "paper" else 0.0)
        self._resolve_density()

    def _resolve_density(self) -> None:
        if self.sigma_s is None:
            visibility = self.visibility_m if self.visibility_m is not None else DEFAULT_VISIBILITY_M
            sigma_t = KOSCHMIEDER / visibility / self.alpha if self.alpha > 0 else self.sigma_a
            if sigma_t < self.sigma_a:
                raise InputError(
                    f"visibility_m: expected at most {KOSCHMIEDER / self.sigma_a / self.alpha:g} m with sigma_a = "
                    f"{self.sigma_a:g} /m, got {visibility:g}"
                )
            object.__setattr__(self, "sigma_s", sigma_t - self.sigma_a)
        implied = KOSCHMIEDER / self.extinction if self.extinction > 0 else 1e9
        if self.visibility_m is not None and not math.isclose(implied, self.visibility_m, rel_tol=1e-6):
            raise InputError(
                f"visibility_m: expected either the visibility or sigma_s, got {self.visibility_m:g} m and "
                f"sigma_s = {self.sigma_s:g} /m, which means {implied:g} m"
            )
        if self.visibility_m is None:
            object.__setattr__(self, "visibility_m", min(max(implied, 1e-3), 1e9))

    @property
    def extinction(self) -> float:
        """sigma_t = alpha (sigma_s + sigma_a) [1/m]."""
        assert self.sigma_s is not None  # set by __post_init__
        return self.alpha * (self.sigma_s + self.sigma_a)
