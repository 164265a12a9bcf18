"""What lights a frame and where it is in the world, in the arrays in which it reaches the passes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from aw4d.lights.light import LightArrays


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """Local lights, the environment's tables, and the frame's place in the world by the passes' argument names."""

    lights: LightArrays
    environment: Mapping[str, Any] = field(default_factory=dict)
    world: Mapping[str, Any] = field(default_factory=dict)

    def arguments(self) -> dict[str, Any]:
        """Everything by argument name."""
        lights = {held.name: getattr(self.lights, held.name) for held in fields(self.lights)}
        return lights | dict(self.environment) | dict(self.world)
