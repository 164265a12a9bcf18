"""Painters of the ground: asphalt with its markings, pavement."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from aw4d.street import layout
from aw4d.street.noise import cell, cell_value, fade, fractal_noise, smoothstep, span, stripes, value_noise
from aw4d.street.parts import Part
from aw4d.street.surface import Samples, Surface, mix, tint

Array = NDArray[Any]


def asphalt(part: Part, s: Samples, out: Surface) -> None:
    """Road: worn asphalt with repairs, cracks, wheel tracks, manholes and markings."""
    (x, _, z), (fx, _, fz) = s.position, s.footprint
    shade = 0.80 + 0.40 * (fractal_noise(x / 5, z / 2, 3, seed=1) - 0.5)
    shade += 0.9 * (value_noise(x / 0.014, z / 0.014, seed=2) - 0.5) * fade(0.02, fx)
    shade += 0.25 * (value_noise(x / 0.05, z / 0.05, seed=3) - 0.5) * fade(0.06, fx)
    lane = np.abs(np.abs(z) - layout.EGO_Z)
    shade += 0.10 * np.exp(-(((lane - 0.75) / 0.28) ** 2)) - 0.13 * np.exp(-((lane / 0.35) ** 2))
    shade -= 0.25 * smoothstep(layout.ROAD_HALF - 0.5, layout.ROAD_HALF, np.abs(z))
    shade *= _repairs(x, z, fx, fz) * _cracks(x, z, fx)
    base = tint((0.205, 0.200, 0.192), np.maximum(shade, 0.1))
    paint = _markings(x, z, fx, fz)
    worn = smoothstep(0.22, 0.5, fractal_noise(x / 0.25, z / 0.12, 2, seed=7) + 0.10)
    out.albedo[:] = mix(base, (0.68, 0.67, 0.63), paint * (0.35 + 0.6 * worn))
    out.roughness[:] = 0.88 - 0.2 * paint


def _repairs(x: Array, z: Array, fx: Array, fz: Array) -> Array:
    """Shade of rectangular patches, one in some of the cells of a coarse grid, each with a dark seam; and manholes."""
    i, j = cell(x / 11), cell(z / 3.1)
    chosen = cell_value(i, j, 31) < 0.33
    u, v = x - 11 * i, z - 3.1 * j
    x0, z0 = 1 + 5 * cell_value(i, j, 32), 0.3 + 0.8 * cell_value(i, j, 33)
    x1, z1 = x0 + 1.2 + 3 * cell_value(i, j, 34), z0 + 0.9 + 0.9 * cell_value(i, j, 35)
    patch = span(u, x0, x1, fx) * span(v, z0, z1, fz)
    seam = patch - span(u, x0 + 0.05, x1 - 0.05, fx) * span(v, z0 + 0.05, z1 - 0.05, fz)
    shade = 1 - chosen * (patch * (0.30 * cell_value(i, j, 36) - 0.02) + 0.45 * seam)
    lid = np.hypot(u - 9.0, z - np.where(j > 0, 1.0, -2.2))
    here = (cell_value(i, j * 0, 37) < 0.3) * fade(0.5, fx)
    ring = smoothstep(0.40, 0.37, lid) * (
        0.35 + 0.35 * smoothstep(0.33, 0.30, lid) * smoothstep(0.2, 0.9, np.sin(u * 60))
    )
    return shade * (1 - here * ring)


def _cracks(x: Array, z: Array, fx: Array) -> Array:
    """Shade of thin dark cracks along the zero line of a noise, in stretches."""
    line = np.abs(fractal_noise(x / 1.6, z / 3.0, 3, seed=21) - 0.5)
    where = smoothstep(0.62, 0.75, value_noise(x / 7, z / 3, seed=25))
    return 1 - 0.45 * where * smoothstep(0.008, 0.003, line) * fade(0.12, fx)


def _markings(x: Array, z: Array, fx: Array, fz: Array) -> Array:
    """Share of white paint: centre line, parking line, stop lines, zebra crossings."""
    to_crossing = (x - layout.CROSSING + layout.BLOCK / 2) % layout.BLOCK - layout.BLOCK / 2
    away, edge = np.abs(to_crossing), layout.CROSSING_HALF
    dashes = stripes(x, 6.0, 2.6, fx) * span(away, edge + 20, 1e3, fx) + span(away, edge + 5.4, edge + 20, fx)
    paint = span(z, -0.06, 0.06, fz) * dashes
    bays = stripes(x - 0.4, 6.1, 0.12, fx) * span(np.abs(z), layout.LANE_EDGE, layout.LANE_EDGE + 0.5, fz)
    lane_edge = span(np.abs(z), layout.LANE_EDGE - 0.05, layout.LANE_EDGE + 0.05, fz)
    paint += (lane_edge + bays) * span(away, edge + 8.2, 1e3, fx)
    approach = np.where(to_crossing < 0, z, -z)
    paint += span(away, edge + 4.6, edge + 5.0, fx) * span(approach, 0.15, layout.ROAD_HALF - 0.25, fz)
    paint += (
        span(away, edge + 0.9, edge + 3.8, fx) * stripes(z + 0.25, 1.0, 0.5, fz) * (np.abs(z) < layout.ROAD_HALF - 0.25)
    )
    return np.minimum(paint, 1)


def pavement(part: Part, s: Samples, out: Surface) -> None:
    """Slabs, kerb stones, tree pits, and lawn behind the house fronts."""
    (x, _, z), (fx, _, fz) = s.position, s.footprint
    across = np.abs(z) - layout.ROAD_HALF
    i, j = cell(x / 0.8), cell(across / 0.6)
    slab = (
        0.90 + 0.16 * (cell_value(i, j, 41) - 0.5) * fade(0.8, fx) + 0.3 * (fractal_noise(x / 3, z / 1.5, 3, 42) - 0.5)
    )
    slab += 0.25 * (value_noise(x / 0.02, z / 0.02, 44) - 0.5) * fade(0.03, fx)
    joint = 1 - (1 - stripes(x, 0.8, 0.012, fx)) * (1 - stripes(across, 0.6, 0.012, fz))
    base = tint((0.40, 0.385, 0.36), slab * (1 - 0.55 * joint))
    kerb = np.where(s.face == 3, span(across, -1, 0.16, fz), 1)
    stone = tint(
        (0.47, 0.46, 0.44), 1 + 0.25 * (fractal_noise(x / 0.7, z / 0.7, 2, 45) - 0.5) - 0.5 * stripes(x, 1.0, 0.012, fx)
    )
    base += (stone - base) * kerb
    half = layout.TREE_STEP / 2
    from_tree = np.abs((x - part.origin[0] - layout.FIRST_TREE + half) % layout.TREE_STEP - half)
    pit = span(from_tree, -1, 0.6, fx) * span(np.abs(across - 1.2), -1, 0.6, fz)
    base = mix(base, (0.09, 0.07, 0.05), pit * (0.8 + 0.2 * value_noise(x / 0.1, z / 0.1, 46)))
    lawn = smoothstep(3.72, 3.74, across) * (fractal_noise(x / 4, z / 4, 3, 47) * 0.6 + 0.7)
    out.albedo[:] = np.where(across > 3.73, tint((0.09, 0.15, 0.035), lawn), base)
    out.roughness[:] = 0.9
