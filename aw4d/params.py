"""Every parameter of every pass: unit, range and source on each field; defaults live here and nowhere else."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, Literal

from aw4d.errors import InputError

RGB = tuple[float, float, float]
CONVENTIONS = ("physical", "paper")
KOSCHMIEDER = 3.912  # -ln(0.02): contrast left at the visibility, Koschmieder 1924
DEFAULT_VISIBILITY_M = 150.0


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


@dataclass(frozen=True, kw_only=True)
class Params:
    """Base of all parameters: checks every field against its documented range.

    Raises
    ------
    InputError
        A number is not finite or out of range; the message names the field, its range and what came.
    """

    def __post_init__(self) -> None:
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
        None, "linear", "the fog's colour (default: the clip's mean radiance)", "paper, Fog blending", low=0, high=1e3
    )
    nodes: int = param(8, "1", "the even number of quadrature nodes a light", "Gauss-Legendre", low=2, high=64)
    extent_m: float = param(2e4, "m", "the longest path through the fog, also to the sky", "", low=1, high=1e5)
    convention: Literal["physical", "paper"] = param("physical", "", "the formulas: physical or paper", "docs/paper.md")

    def __post_init__(self) -> None:
        if self.convention not in CONVENTIONS:
            raise InputError(f"convention: expected {' or '.join(CONVENTIONS)}, got {self.convention!r}")
        if self.nodes % 2:
            raise InputError(f"nodes: expected an even number, got {self.nodes}")
        super().__post_init__()
        if self.beta is None:
            object.__setattr__(self, "beta", 0.5 if self.convention == "paper" else 0.0)
        self._resolve_density()

    def _resolve_density(self) -> None:
        if self.sigma_s is None:
            visibility = self.visibility_m if self.visibility_m is not None else DEFAULT_VISIBILITY_M
            sigma_t = KOSCHMIEDER / visibility / self.alpha if self.alpha > 0 else 0.0
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


@dataclass(frozen=True, kw_only=True)
class HeadlightParams(Params):
    """The ego vehicle's own lamps, a pair fixed to the camera. Paper, supplement "Light Source Implementation"."""

    on: bool = param(True, "", "whether they burn", "", host=True)
    candela: float = param(20_000.0, "cd", "the luminous intensity on the axis", "UN R149 low beam", low=0, high=1e6)
    # Deep dusk, so that the beams show in a bright fog: at g = 0.8 the phase function sends back a fraction of what
    # droplets do, and a recording by day has no exposure that would fit lamps.
    white_cd_m2: float = param(
        12.0, "cd/m2", "the luminance that the picture shows as white", "docs/fog.md", low=1e-3, high=1e6
    )
    color: RGB = param((1.0, 0.93, 0.82), "linear", "the colour of the lamps", "warm white", low=0, high=1)
    spacing_m: float = param(1.3, "m", "the distance between the lamps", "", low=0, high=3)
    below_m: float = param(0.9, "m", "how far they are below the camera", "", low=-1, high=4)
    ahead_m: float = param(1.6, "m", "how far they are ahead of the camera", "", low=-1, high=4)
    pitch_deg: float = param(1.0, "deg", "the dip of the beam", "UN R48: 1 to 2 %", low=-10, high=20)
    inner_deg: float = param(10.0, "deg", "the half angle of full brightness", "paper", low=0.1, high=89)
    outer_deg: float = param(25.0, "deg", "the half angle of darkness", "paper", low=0.2, high=89.9)
    r_max_m: float = param(50.0, "m", "the reach", "paper: 30 to 50 m", low=1, high=1e4)


@dataclass(frozen=True, kw_only=True)
class LightParams(Params):
    """Lights given by hand."""

    file: str = param("", "", "a JSON file of lights", "docs/lights.md", host=True)
