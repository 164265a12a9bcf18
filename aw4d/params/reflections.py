"""Parameters of the reflections on wet ground."""

from __future__ import annotations

from dataclasses import dataclass

from aw4d.params.base import Params, param


@dataclass(frozen=True, kw_only=True)
class ReflectionsParams(Params):
    """What wet ground mirrors of the frame itself."""

    steps: int = param(
        28, "1", "the samples of a mirrored ray before finer ones", "docs/reflections.md", low=4, high=256
    )
    reach_m: float = param(150.0, "m", "how far things are mirrored", "", low=1, high=1e5)
    thickness_m: float = param(
        0.5, "m", "how far things reach below what is seen of them", "docs/reflections.md", low=0.01, high=100
    )
    max_roughness: float = param(
        0.5, "1", "the roughness from which on nothing is mirrored", "docs/reflections.md", low=0.01, high=1
    )
