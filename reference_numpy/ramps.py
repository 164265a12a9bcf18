"""From 0 to 1 without a kink."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def smoothstep(low: float, high: float, x: Array) -> Array:
    """0 below one end, 1 beyond the other, without a kink at either; `low` may be the greater."""
    t = np.clip((x - low) / (high - low), 0.0, 1.0)
    out: Array = t * t * (3 - 2 * t)
    return out
