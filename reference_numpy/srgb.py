"""sRGB (IEC 61966-2-1): linear light to display code value and back, and the luminance of its primaries."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # of the three channels, Rec. 709


def encode(linear: ArrayLike) -> NDArray[np.float64]:
    """The transfer function for any linear light >= 0: carried on beyond 1, where sRGB ends. Any shape."""
    x = np.asarray(linear, dtype=np.float64)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.power(x, 1 / 2.4) - 0.055)


def decode(code: ArrayLike) -> NDArray[np.float64]:
    """The inverse of `encode` for any code >= 0. Any shape."""
    x = np.asarray(code, dtype=np.float64)
    return np.where(x <= 0.04045, x / 12.92, np.power((x + 0.055) / 1.055, 2.4))


def linear_to_srgb(linear: ArrayLike) -> NDArray[np.float64]:
    """Encode linear light in [0, 1] to sRGB in [0, 1]; values outside are clipped. Any shape."""
    return encode(np.clip(np.asarray(linear, dtype=np.float64), 0.0, 1.0))


def srgb_to_linear(code: ArrayLike) -> NDArray[np.float64]:
    """Decode sRGB in [0, 1] to linear light in [0, 1]; values outside are clipped. Any shape."""
    return decode(np.clip(np.asarray(code, dtype=np.float64), 0.0, 1.0))
