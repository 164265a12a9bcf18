"""Light from all around: octahedral tables and their lookup, and the lobes in which surfaces reflect it.

A table holds a quantity for every direction of the world (y up) on a square: a direction d goes to
d / (|x| + |y| + |z|), whose upper half falls on the inner diamond (x, z) and whose lower half is folded out to the
corners (octahedral map, Engelhardt and Dachsbacher 2008). Texels sit on the square's corners and edges, not inside,
so that a bilinear lookup needs no texel beyond an edge and is continuous everywhere.

Under an overcast sky all light has one colour and depends on the elevation alone. One table then does for all: cells
between neighbouring heights on the unit sphere (y) and neighbouring rows, four corners each. Its last row of cells is
the irradiance over pi, the others are levels of roughness.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

LOBES = 4  # round ones, for the two parts of Schlick's Fresnel term F0 (1 - x) + x
PARTS = (slice(0, 3), slice(3, 4))  # of the part with F0, long at a slant: three, side by side; of the other: one
FADING = 0.02  # [1] of occlusion, over which what is all but occluded fades out


def octahedral(d: Array) -> tuple[Array, Array]:
    """Place of directions (..., 3) on the square, both coordinates in [-1, 1]; any length but 0."""
    size = np.maximum(np.abs(d).sum(axis=-1), 1e-9)
    x, y, z = (d[..., i] / size for i in range(3))
    below = y < 0
    return (
        np.where(below, np.copysign(1 - np.abs(z), x), x),
        np.where(below, np.copysign(1 - np.abs(x), z), z),
    )


def octahedral_direction(x: ArrayLike, z: ArrayLike) -> Array:
    """Unit vectors (..., 3) of places on the square: the inverse of `octahedral`."""
    x, z = np.asarray(x, dtype=np.float64), np.asarray(z, dtype=np.float64)
    y = 1 - np.abs(x) - np.abs(z)
    fold = np.maximum(-y, 0.0)
    d = np.stack([x - np.copysign(fold, x), y, z - np.copysign(fold, z)], axis=-1)
    unit: Array = d / np.linalg.norm(d, axis=-1, keepdims=True)
    return unit


def octahedral_grid(size: int) -> Array:
    """Directions of a table's texels, (size, size, 3): x along the rows, z down the columns."""
    at = np.linspace(-1, 1, size)
    return octahedral_direction(at[None, :], at[:, None])


def _corner(at: Array, size: int) -> tuple[NDArray[np.int64], Array]:
    """First of the two texels that a coordinate in texels lies between, and the weight of the second."""
    first = np.clip(np.floor(at).astype(np.int64), 0, max(size - 2, 0))
    return first, at - first


def bilinear(table: Array, x: Array, y: Array) -> Array:
    """Table (H, W, C) at texel coordinates within it, (...) to (..., C)."""
    height, width = table.shape[:2]
    c, fx = _corner(x, width)
    r, fy = _corner(y, height)
    fx, fy = fx[..., None], fy[..., None]
    top = table[r, c] + fx * (table[r, c + 1] - table[r, c])
    low = table[r + 1, c] + fx * (table[r + 1, c + 1] - table[r + 1, c])
    out: Array = top + fy * (low - top)
    return out


def lookup(table: Array, d: Array) -> Array:
    """Octahedral table (N, N, 4), RGB and one number that is not used, in directions (..., 3), to (..., 3)."""
    half = (table.shape[0] - 1) / 2
    x, z = octahedral(d)
    return bilinear(table, x * half + half, z * half + half)[..., :3]


def prefiltered(table: Array, d: Array, roughness: Array) -> Array:
    """Table of levels (L, N, N, 4), for roughness 0 to 1 in equal steps, in directions (..., 3), to (..., 3)."""
    level, f = _corner(roughness * (len(table) - 1), len(table))
    near, far = (np.zeros((*level.shape, 3)) for _ in range(2))
    for i in np.unique(level):
        here = level == i
        near[here], far[here] = lookup(table[i], d[here]), lookup(table[i + 1], d[here])
    return near + f[..., None] * (far - near)


def zonal(cells: Array, d: Array, row: NDArray[np.int64] | int, more: Array | float) -> Array:
    """Cells (R, E, 4), at `more` of the way down a row of them, in directions (..., 3) of any length but 0, to (...).

    A cell's corners are left, right, lower left and lower right; heights -1 to 1 go from left to right.
    """
    size = np.maximum(np.linalg.norm(d, axis=-1), 1e-9)
    left, f = _corner((d[..., 1] / size + 1) * (cells.shape[1] / 2), cells.shape[1] + 1)
    a, b, c, e = np.moveaxis(cells[row, left], -1, 0)
    upper = a + f * (b - a)
    out: Array = upper + more * (c + f * (e - c) - upper)
    return out


@dataclass(frozen=True, kw_only=True)
class Surroundings:
    """Light from all around.

    Parameters
    ----------
    specular
        (L, N, N, 4) prefiltered radiance by roughness and direction.
    zonal, colour
        (L, E, 4) cells, (3,); they count in place of octahedral tables unless E is 0.
    """

    specular: Array
    zonal: Array
    colour: Array

    def irradiance_on(self, normal: Array, table: Array) -> Array:
        """Of surfaces that face (..., 3), to (..., 3); octahedral table (N, N, 4)."""
        if not self.zonal.size:
            return lookup(table, normal)
        return np.pi * zonal(self.zonal, normal, len(self.zonal) - 1, 0.0)[..., None] * self.colour

    def prefiltered(self, d: Array, roughness: Array) -> Array:
        """Mean radiance around directions (..., 3), as wide as the lobe of a roughness, to (..., 3)."""
        if not self.zonal.size:
            return prefiltered(self.specular, d, roughness)
        level, more = _corner(roughness * (len(self.zonal) - 1), len(self.zonal))
        return zonal(self.zonal, d, level, more)[..., None] * self.colour


def lobes(table: Array, NoV: Array, roughness: Array) -> Array:
    """The round lobes that stand for the reflection's, (..., LOBES, 3): share, turn and roughness of each.

    Table (M, M, LOBES, 4): rows for roughness 0 to 1, columns for sqrt(NoV) 0 to 1, in equal steps. Its channels: the
    share of white surroundings' light that is reflected (all of a part's are A or B of Karis 2013), how far the lobe is
    turned from the mirror direction (0) to the normal (1) and beyond, the roughness of the table in `prefiltered` that
    is as wide, and one that is not used. `PARTS` says which lobes stand for which part of Schlick's Fresnel term.
    """
    last = table.shape[0] - 1
    found = bilinear(table.reshape(*table.shape[:2], -1), np.sqrt(NoV) * last, roughness * last)
    return found.reshape(*found.shape[:-1], LOBES, 4)[..., :3]


def reflection(around: Surroundings, part: Array, mirror: Array, normal: Array) -> Array:
    """Light of lobes (..., K, 3) that stand for a part, (..., 3); directions (..., 3)."""
    light = np.zeros(mirror.shape)
    for share, turn, roughness in (np.moveaxis(part[..., k, :], -1, 0) for k in range(part.shape[-2])):
        d = mirror + turn[..., None] * (normal - mirror)
        light += share[..., None] * around.prefiltered(d, roughness)
    return light


def specular_occlusion(NoV: Array, occlusion: Array, roughness: Array) -> Array:
    """Share of the specular lobe that is not occluded, 0 where `occlusion` is.

    Lagarde and de Rousiers 2014, but not cut off at 0, near which rounding would be all that is left: it fades out.
    That is at most `FADING` / 2 more.
    """
    open_ = (NoV + occlusion) ** np.exp2(-16 * roughness - 1) - 1 + occlusion
    faded = 0.5 * (open_ + np.sqrt(open_**2 + FADING**2))
    return np.minimum(faded, np.minimum(4 * occlusion, 1.0))
