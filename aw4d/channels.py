"""Colours pixel after pixel and channel after channel: from one order to the other at memory speed."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray


def write_planar(values: NDArray[Any], out: NDArray[Any]) -> None:
    """Write an (H, W) or (H, W, 3) plane to (channels, H, W), whose rows may lie apart."""
    if values.ndim == 2:
        out[0] = values
    else:
        cv2.split(values, list(out))  # twice as fast as NumPy's strided copy; the way back eight times


def by_pixels(planar: NDArray[Any]) -> NDArray[Any]:
    """(H, W) or (H, W, 3), contiguous, of (channels, H, W)."""
    return np.ascontiguousarray(planar[0] if len(planar) == 1 else cv2.merge(list(planar)))
