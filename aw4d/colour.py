"""Eight-bit sRGB images to scene-linear planes and back, by table: exact and at memory speed."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from reference_numpy import srgb

LUMINANCE = srgb.LUMINANCE.astype(np.float32)  # pictures are float32, and so is their luminance

_TO_LINEAR = srgb.srgb_to_linear(np.arange(256) / 255).astype(np.float32)
_CODE_BITS = 16
# The steepest part of the curve rises by 12.92 * 255 / 65535 = 0.05 codes a step: the table rounds correctly
# everywhere but within 0.025 codes of a tie.
_TO_CODE = np.rint(srgb.linear_to_srgb(np.arange(2**_CODE_BITS) / (2**_CODE_BITS - 1)) * 255).astype(np.uint8)


def decode_srgb8(image: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Scene-linear float32 of an 8-bit sRGB image; any shape."""
    return look_up(_TO_LINEAR, image)


def srgb_codes(linear: NDArray[np.floating]) -> NDArray[np.float64]:
    """8-bit codes of scene-linear values clipped to [0, 1], but not rounded, to measure differences in; any shape."""
    return np.asarray(255 * srgb.linear_to_srgb(np.clip(linear.astype(np.float64), 0.0, 1.0)), dtype=np.float64)


def encode_srgb8(linear: NDArray[np.floating]) -> NDArray[np.uint8]:
    """8-bit sRGB of scene-linear values, clipped to [0, 1]; any shape."""
    scaled = np.clip(linear, 0.0, 1.0)
    scaled *= 2**_CODE_BITS - 1
    scaled += 0.5
    return look_up(_TO_CODE, scaled.astype(np.uint16))


def look_up(table: NDArray[Any], codes: NDArray[Any]) -> NDArray[Any]:
    """`table[codes]`, four times as fast; the table has an entry for every code of 8 or 16 bits. Any shape."""
    rows = np.ascontiguousarray(codes).reshape(1, -1)  # OpenCV takes three dimensions as a picture's
    found: NDArray[Any] = np.asarray(cv2.LUT(rows, table)) if codes.size else table[:0]
    return found.reshape(codes.shape)
