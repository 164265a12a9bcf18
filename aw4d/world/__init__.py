"""What anchors a frame's weather to the world: the camera's place, vehicles' own frames, tyre tracks, what falls."""

from __future__ import annotations

from aw4d.world.anchor import anchor
from aw4d.world.arguments import world_arguments

__all__ = ["anchor", "world_arguments"]
