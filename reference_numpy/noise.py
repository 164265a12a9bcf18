"""Noise on lattices of the world: integer hashes of cells, bit-equal on every device, and smooth value noise.

A hash takes a cell's integer coordinates, never a position: what is drawn for a cell is the same from every frame and
every crop, at any distance from the world's origin.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Hash = NDArray[np.uint32]


def scramble(h: Hash) -> Hash:
    """Every bit of 32 spread over all of them. Wellons 2018 ("lowbias32")."""
    h = (h ^ (h >> np.uint32(16))) * np.uint32(0x7FEB352D)
    h = (h ^ (h >> np.uint32(15))) * np.uint32(0x846CA68B)
    return h ^ (h >> np.uint32(16))


def hash2(x: ArrayLike, z: ArrayLike, seed: int) -> Hash:
    """A cell's 32 bits, of its integer coordinates, taken modulo 2^32."""
    column, row = (np.asarray(i, dtype=np.int64).astype(np.uint32) for i in (x, z))
    return scramble(column * np.uint32(0x9E3779B1) + scramble(row * np.uint32(0x85EBCA77) + np.uint32(seed)))


def unit(h: Hash) -> Array:
    """A number in [0, 1) out of the upper 24 bits: exact in float32."""
    return (h >> np.uint32(8)).astype(np.float64) * 2.0**-24


def halves(h: Hash) -> tuple[Array, Array]:
    """Two numbers in [0, 1), of the lower and of the upper 16 bits."""
    return (h & np.uint32(0xFFFF)).astype(np.float64) * 2.0**-16, (h >> np.uint32(16)).astype(np.float64) * 2.0**-16


def fade(t: Array) -> Array:
    """0 to 1 without a kink at either end, nor in its slope. Perlin 2002."""
    out: Array = t * t * t * (t * (t * 6 - 15) + 10)
    return out


def value_noise(x: NDArray[np.int64], z: NDArray[np.int64], u: Array, w: Array, seed: int) -> Array:
    """Smooth noise, 0 to 1, in cells (x, z) at the places (u, w) within them, 0 to 1."""
    fu, fw = fade(u), fade(w)
    corners = [[unit(hash2(x + i, z + j, seed)) for i in (0, 1)] for j in (0, 1)]
    near, far = (a + fu * (b - a) for a, b in corners)
    out: Array = near + fw * (far - near)
    return out
