"""Everything that one run of the bench found, and as strict JSON."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any

from aw4d.bench import quality
from aw4d.bench.against import PeerRow
from aw4d.bench.curves import CostPoint, MemoryPoint, PixelFit
from aw4d.bench.fronts import HalfRow, Point
from aw4d.bench.left_out import LeftOut
from aw4d.bench.limits import Limits
from aw4d.bench.passes import PassRow
from aw4d.bench.whole import WholeRow

MEASURE = "|x - ref| / max(|ref|, 1e-3 p99(|ref|)); reference: numpy float64"


@dataclass(kw_only=True)
class Found:
    """Rows by section; `seconds` is the wall time of each section."""

    about: dict[str, Any] = field(default_factory=dict)
    limits: list[Limits] = field(default_factory=list)
    passes: list[PassRow] = field(default_factory=list)
    peers: list[PeerRow] = field(default_factory=list)
    today: list[PeerRow] = field(default_factory=list)
    knobs: list[Point] = field(default_factory=list)
    qualities: list[quality.Point] = field(default_factory=list)
    half_planes: list[HalfRow] = field(default_factory=list)
    pixels: list[PixelFit] = field(default_factory=list)
    costs: list[CostPoint] = field(default_factory=list)
    memory: list[MemoryPoint] = field(default_factory=list)
    whole: list[WholeRow] = field(default_factory=list)
    left_out: list[LeftOut] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """The same as strict JSON holds it; null is what was not measured, "inf" an error without bounds."""
        out: dict[str, Any] = plain(self)
        return {"measure": MEASURE} | out


def plain(value: Any) -> Any:
    """A value as strict JSON holds it."""
    if is_dataclass(value) and not isinstance(value, type):
        return {one.name: plain(getattr(value, one.name)) for one in fields(value)}
    if isinstance(value, dict):
        return {str(key): plain(one) for key, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(one) for one in value]
    if isinstance(value, float) and not math.isfinite(value):
        return "inf"
    return value
