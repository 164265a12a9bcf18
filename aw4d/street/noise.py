"""World-anchored noise: hashed integer lattices and box-filtered stripes.

Every value is a function of position alone, so that nothing swims when the camera moves. The lattices look their values
up in one table that an integer hash fills, which is quicker than hashing at every sample and just as repeatable.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

_SIDE = 256  # cells until a lattice repeats


def _hash_table() -> NDArray[np.float32]:
    """Uniform numbers in [0, 1), one a cell: the cell's number through a 32-bit mixer (Wellons 2018, "lowbias32")."""
    h = np.arange(_SIDE * _SIDE, dtype=np.uint32) + np.uint32(0x9E3779B9)
    h = (h ^ (h >> np.uint32(16))) * np.uint32(0x7FEB352D)
    h = (h ^ (h >> np.uint32(15))) * np.uint32(0x846CA68B)
    h ^= h >> np.uint32(16)
    return (h >> np.uint32(8)).astype(np.float32) * np.float32(2.0**-24)


_TABLE = _hash_table()


def cell(position: Array) -> NDArray[np.int32]:
    """Number of the lattice cell of side 1 that holds each position (floor, not truncation)."""
    return np.floor(position).astype(np.int32)


def cell_value(i: Array, j: Array, seed: Array | int = 0) -> NDArray[np.float32]:
    """Uniform number in [0, 1) of an integer cell (i, j); another seed gives another, unrelated lattice."""
    return _TABLE[((i + seed * 57) & 255) | (((j + seed * 131) & 255) << 8)]


def cell_value3(i: Array, j: Array, k: Array, seed: int = 0) -> NDArray[np.float32]:
    """Uniform number in [0, 1) of an integer cell in space."""
    return _TABLE[(i + j * 1579 + k * 31337 + seed * 7919) & 0xFFFF]


def value_noise(x: Array, y: Array, seed: int = 0) -> NDArray[np.float32]:
    """Smooth noise in [0, 1] with features of size 1: lattice values blended by a smooth step."""
    i, j = cell(x), cell(y)
    fx, fy = (x - i).astype(np.float32), (y - j).astype(np.float32)
    fx *= fx * (3 - 2 * fx)
    fy *= fy * (3 - 2 * fy)
    column = (i + seed * 57) & 255
    next_column = (column + 1) & 255
    row = ((j + seed * 131) & 255) << 8
    next_row = (row + 256) & 0xFFFF
    low = _TABLE[column | row]
    low += fx * (_TABLE[next_column | row] - low)
    high = _TABLE[column | next_row]
    high += fx * (_TABLE[next_column | next_row] - high)
    low += fy * (high - low)
    return low


def fractal_noise(x: Array, y: Array, octaves: int, seed: int = 0) -> NDArray[np.float32]:
    """Sum of octaves of `value_noise`, each half as large and twice as fine, scaled to [0, 1]."""
    total = np.zeros(np.broadcast(x, y).shape, np.float32)
    for octave in range(octaves):
        total += value_noise(x * 2**octave, y * 2**octave, seed + octave) * np.float32(0.5**octave)
    return total / np.float32(2 - 0.5 ** (octaves - 1))


def smoothstep(low: float, high: float, x: Array) -> Array:
    """Smooth ramp from 0 at `low` to 1 at `high`."""
    ramp = np.clip((x - low) / (high - low), 0, 1)
    return ramp * ramp * (3 - 2 * ramp)


def span(x: Array, low: Array | float, high: Array | float, width: Array) -> Array:
    """Share of a filter box of the given width, centred at x, that lies within [low, high]."""
    return np.clip((np.minimum(x + width / 2, high) - np.maximum(x - width / 2, low)) / width, 0, 1)


def stripes(x: Array, period: Array | float, line: float, width: Array) -> Array:
    """Share of a filter box, centred at x, that lies on lines [0, line) repeated every `period`."""

    def integral(at: Array) -> Array:
        turns = np.floor(at / period)
        return turns * line + np.minimum(at - turns * period, line)

    return (integral(x + width / 2) - integral(x - width / 2)) / width


def fade(size: float, width: Array) -> Array:
    """How much of a pattern of the given feature size outlives a filter of the given width: 1 near, 0 far."""
    return np.clip(1.5 - width / size, 0, 1)
