"""Parameters of the local lights' pass."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from aw4d.params.base import Params, param


@dataclass(frozen=True, kw_only=True)
class SpotLightsParams(Params):
    """Light of lamps on the surfaces. Paper, supplement "BRDF Modeling" and "Light Source Implementation"."""

    convention: Literal["physical", "paper"] = param("physical", "", "the formulas: physical or paper", "docs/paper.md")
