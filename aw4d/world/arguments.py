"""Everything about the world that the passes of a frame take, by argument name."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any

import numpy as np

from aw4d.clip import ClipInfo
from aw4d.weathers import Settings
from aw4d.world.anchor import anchor
from aw4d.world.falling import rain_arguments, snow_arguments
from aw4d.world.tracks import track_arguments
from aw4d.world.vehicle_frames import vehicle_frames


def _snow_cover(info: ClipInfo, settings: Settings, index: int) -> dict[str, Any]:
    p, moving = settings.snow_cover, settings.vehicle_lights
    frames = vehicle_frames(info, index, vehicle_share=p.vehicle_share, moving=moving)
    return frames | track_arguments(info, index, gauge_m=p.track_gauge_m, width_m=p.track_width_m, moving=moving)


# What a pass takes of the world besides the anchor, by the pass' name.
PREPARED: dict[str, Callable[[ClipInfo, Settings, int], dict[str, Any]]] = {
    "rain_streaks": lambda info, settings, index: rain_arguments(settings.rain_streaks, info, index),
    "snow_cover": _snow_cover,
    "snow_fall": lambda info, settings, index: snow_arguments(settings.snow_fall, info, index),
}


def _haze(settings: Settings, passes: Collection[str]) -> dict[str, Any]:
    """What hangs in the air between particles: fog, where there is any."""
    fog = settings.fog
    if "fog" not in passes or fog.color is None or not fog.extinction:
        return {"haze_extinction": 0.0, "haze_color": np.zeros(3, np.float32)}
    scattered = 1 - fog.alpha * fog.sigma_a / fog.extinction
    return {"haze_extinction": fog.extinction, "haze_color": np.float32(scattered) * np.array(fog.color, np.float32)}


def world_arguments(info: ClipInfo, settings: Settings, passes: Collection[str], index: int) -> dict[str, Any]:
    """Arguments of some passes for a frame: a pure function of the clip, the settings and the frame's number.

    Parameters
    ----------
    info
        The clip's cameras, times and boxes.
    settings
        All parameters.
    passes
        Names of the passes that will run.
    index
        Number of the frame.

    Returns
    -------
    dict
        Values by argument name; `PASS.ARGUMENT` where they are of one pass alone.
    """
    out = anchor(info.camera(index), float(info.times[index]), info.world_origin) | _haze(settings, passes)
    for name in passes:
        if name in PREPARED:
            out |= {f"{name}.{key}": value for key, value in PREPARED[name](info, settings, index).items()}
    return out
