"""What lights a frame, in the arrays in which it reaches the passes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from aw4d.lights.light import LightArrays


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """Local lights, and the environment's tables by the argument names that the passes take."""

    lights: LightArrays
    environment: Mapping[str, Any] = field(default_factory=dict)

    def arguments(self) -> dict[str, Any]:
        """Everything by argument name."""
        lights = {held.name: getattr(self.lights, held.name) for held in fields(self.lights)}
        return lights | dict(self.environment)
