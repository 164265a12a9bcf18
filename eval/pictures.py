"""What every metric of two pictures asks of them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from eval.errors import MetricError


def check_pair(metric: str, ref: NDArray[Any], gen: NDArray[Any]) -> None:
    """Two pictures of one shape, (H, W) or (H, W, 3), and of one dtype: uint8, or floats that are all finite.

    Raises
    ------
    MetricError
        They are not.
    """
    if ref.shape != gen.shape or ref.dtype != gen.dtype:
        raise MetricError(
            f"{metric}: expected two pictures of one shape and dtype, "
            f"got {ref.shape} {ref.dtype.name} and {gen.shape} {gen.dtype.name}"
        )
    if not (ref.size and (ref.ndim == 2 or (ref.ndim == 3 and ref.shape[2] == 3))):
        raise MetricError(f"{metric}: expected pictures (H, W) or (H, W, 3), got {ref.shape}")
    if ref.dtype != np.uint8 and ref.dtype not in (np.float32, np.float64):
        raise MetricError(f"{metric}: expected pictures of uint8, float32 or float64, got {ref.dtype.name}")
    if ref.dtype != np.uint8 and not (np.isfinite(ref).all() and np.isfinite(gen).all()):
        raise MetricError(f"{metric}: expected finite values, got NaN or Inf")
