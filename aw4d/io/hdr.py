"""Radiance (.hdr) and OpenEXR environment maps."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aw4d.errors import InputError
from aw4d.io.files import read_bytes
from aw4d.io.images import read_exr_plane

_SIZE = re.compile(rb"-Y (\d+) \+X (\d+)\n")
_RUNS = range(8, 2**15)  # widths for which the format has runs
_LONGEST_RUN, _RUN_BYTES = 127, 2


def read_radiance(path: Path) -> NDArray[np.float64]:
    """Read a lat-long environment map, .hdr or .exr, as (H, 2 H, 3) linear RGB, >= 0.

    Raises
    ------
    InputError
        The file cannot be read, is truncated, is of another kind, is not twice as wide as high, holds a value that is
        not finite, or is black.
    """
    if path.suffix.lower() not in (".hdr", ".exr"):
        raise InputError(f"{path}: expected an environment map, .hdr or .exr")
    image = read_hdr(path) if path.suffix.lower() == ".hdr" else read_exr_plane(path).astype(np.float64)
    if image.ndim != 3 or image.shape[1] != 2 * image.shape[0] or image.shape[0] < 2:
        raise InputError(f"{path}: expected a lat-long map in colour, twice as wide as high, got {image.shape}")
    if not np.isfinite(image).all():
        raise InputError(f"{path}: expected finite radiance, got NaN or infinite values")
    if not (image > 0).any():
        raise InputError(f"{path}: expected a map with light in it, got black")
    return np.maximum(image, 0.0)


def read_hdr(path: Path) -> NDArray[np.float64]:
    """Read a Radiance picture as (H, W, 3) linear RGB. Ward 1994; flat and run-length coded scanlines.

    Raises
    ------
    InputError
        The file cannot be read, is truncated, or is no Radiance picture in RGBE with rows from the top down.
    """
    data = read_bytes(path)
    header, blank, rest = data.partition(b"\n\n")
    size = _SIZE.match(rest)
    if not (data.startswith(b"#?") and blank and b"FORMAT=32-bit_rle_rgbe" in header and size):
        raise InputError(f"{path}: expected a Radiance picture (32-bit_rle_rgbe, -Y height +X width)")
    height, width = int(size[1]), int(size[2])
    try:
        rgbe = _scanlines(rest[size.end() :], height, width)
    except (IndexError, ValueError):
        raise InputError(f"{path}: truncated or damaged Radiance picture") from None
    scale = np.ldexp(1.0, rgbe[..., 3].astype(np.int32) - 136)
    return np.where(rgbe[..., 3:] > 0, rgbe[..., :3] * scale[..., None], 0.0)


def _scanlines(data: bytes, height: int, width: int) -> NDArray[np.uint8]:
    """(H, W, 4) red, green, blue and exponent. Raises IndexError or ValueError where bytes are missing."""
    if width not in _RUNS or data[:2] != b"\2\2":
        return np.frombuffer(data, np.uint8, 4 * height * width).reshape(height, width, 4)
    if len(data) < height * 4 * _RUN_BYTES * -(-width // _LONGEST_RUN):  # before a false size asks for memory
        raise ValueError(height)
    out = np.empty((height, 4, width), np.uint8)
    at = 0
    for row in range(height):
        if data[at : at + 4] != bytes((2, 2, width >> 8, width & 255)):
            raise ValueError(row)
        at += 4
        for channel in range(4):
            line, at = _channel(data, at, width)
            out[row, channel] = np.frombuffer(line, np.uint8)
    return np.moveaxis(out, 1, -1)


def _channel(data: bytes, at: int, width: int) -> tuple[bytes, int]:
    """One channel of a scanline, and where the next one starts: runs (length over 128) and literal bytes."""
    pieces, have = [], 0
    while have < width:
        count = data[at]
        if count > 128:
            count -= 128
            pieces.append(data[at + 1 : at + 2] * count)
            at += 2
        else:
            pieces.append(data[at + 1 : at + 1 + count])
            at += 1 + count
        have += count
        if not count:
            raise ValueError(at)
    return b"".join(pieces), at
