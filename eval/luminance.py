"""Luminance of 8-bit sRGB pictures, by table."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from eval.errors import MetricError

WEIGHTS = (0.2126, 0.7152, 0.0722)  # of linear red, green and blue, Rec. 709


def _linear() -> NDArray[np.float64]:
    code = np.arange(256) / 255
    return np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)  # IEC 61966-2-1


LINEAR = _linear()
_SHARES = [(weight * LINEAR).astype(np.float32) for weight in WEIGHTS]


def check_picture(name: str, picture: NDArray[Any]) -> None:
    """An 8-bit sRGB picture, (H, W, 3).

    Raises
    ------
    MetricError
        It is something else.
    """
    if picture.ndim != 3 or picture.shape[2] != 3 or picture.dtype != np.uint8 or not picture.size:
        raise MetricError(f"{name}: expected a picture (H, W, 3) uint8, got {picture.shape} {picture.dtype.name}")


def luminance(picture: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Linear luminance, (H, W), 1 = white, of an sRGB picture, (H, W, 3).

    Examples
    --------
    >>> luminance(np.array([[[255, 255, 255], [0, 0, 0]]], np.uint8)).tolist()
    [[1.0, 0.0]]
    """
    red, green, blue = (share[picture[..., i]] for i, share in enumerate(_SHARES))
    total: NDArray[np.float32] = red + green + blue
    return total
