"""Where a frame's camera stands in the world and in time, as the passes that are anchored to the world take it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aw4d.camera import Camera
from reference_numpy.world import BLOCK

TICKS = 4096  # a second: time is a whole number of them, exact at any time of day


def anchor(camera: Camera, time: float, origin: ArrayLike = (0.0, 0.0, 0.0)) -> dict[str, Any]:
    """Arguments by name: the camera's block and place in it, its rotation, the up direction, and the time.

    Parameters
    ----------
    camera
        With its pose about `origin`.
    time
        Seconds since the clip's first frame.
    origin
        Where that lies in the recording's own world [m], (3,): one as large as UTM's loses nothing in float64, and a
        clip that was cut elsewhere has the same cells.

    Returns
    -------
    dict
        `block` (3,) int32; `eye`, `eye_lo` (3,) float32 [m] from the block's corner, hi + lo; `to_world`, `to_world_lo`
        (9,) float32 rotation from camera to world, hi + lo; `up` (3,) float32 the world's up in the camera's frame;
        `tick` int32, time in 1 / TICKS s, modulo 2^32.
    """
    R, place = camera.camera_to_world[:3, :3], camera.camera_to_world[:3, 3] + np.asarray(origin)
    block = np.floor(place / BLOCK)
    eye = place - block * BLOCK
    tick = round(time * TICKS)
    return {
        "block": block.astype(np.int64).astype(np.int32),
        "eye": eye.astype(np.float32),
        "eye_lo": _rest(eye).ravel(),
        "to_world": R.astype(np.float32).ravel(),
        "to_world_lo": _rest(R).ravel(),
        "up": R[1].astype(np.float32),
        "tick": int(np.array(tick & 0xFFFFFFFF, dtype=np.uint32).view(np.int32)),
    }


def _rest(values: NDArray[np.float64]) -> NDArray[np.float32]:
    """What rounding to float32 takes off."""
    return (values - values.astype(np.float32)).astype(np.float32)
