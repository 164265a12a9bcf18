"""AutoWeather4D: change the weather and the time of day of recorded driving video."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from aw4d.clip import Clip
    from aw4d.render import Frame

__all__ = ["edit", "load"]
__version__ = "0.1.0"


def load(path: str) -> Clip:
    """Open a clip made by `aw4d ingest`; see `aw4d.clip.Clip`."""
    from aw4d.clip import Clip

    return Clip(path)


def edit(clip: Clip, weather: str, backend: str = "auto", **options: Any) -> Iterator[Frame]:
    """Edit a clip frame by frame; see `aw4d.render.edit` for the options."""
    from aw4d.render import edit as run

    return run(clip, weather, backend=backend, **options)
