"""Painters of houses: masonry, fronts with windows and doors, roofs, awnings."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from aw4d.street.noise import cell, cell_value, fade, fractal_noise, smoothstep, span, stripes, value_noise
from aw4d.street.parts import Part
from aw4d.street.shapes import GLASS, House, Openings, Point
from aw4d.street.surface import Samples, Surface, flat, mix, tint

Array = NDArray[Any]


def wall(part: Part, s: Samples, out: Surface) -> None:
    """Masonry without openings."""
    out.albedo[:] = _masonry(part, s)


def cloth(part: Part, s: Samples, out: Surface) -> None:
    """Striped awning."""
    x, fx = s.position[0], s.footprint[0]
    stripe = stripes(x, 0.5, 0.25, fx)
    out.albedo[:] = mix(flat(part.colour), (0.72, 0.70, 0.66), stripe)


def roof(part: Part, s: Samples, out: Surface) -> None:
    """Rows of tiles up the slope."""
    (x, y, _), (fx, fy, _) = s.position, s.footprint
    row = cell(y / 0.19)
    shift = x + 0.12 * (row & 1)
    tone = (cell_value(cell(shift / 0.24), row, part.seed) - 0.5) * fade(0.24, fx) * fade(0.19, fy)
    tone = 0.45 * tone + 0.4 * (fractal_noise(x / 2.5, y / 2.5, 3, part.seed) - 0.5)
    lines = np.maximum(0.45 * stripes(y, 0.19, 0.03, fy), 0.3 * stripes(shift, 0.24, 0.02, fx))
    gable = np.abs(s.normal[0]) > 0.5
    eaves = s.normal[1] < 0.1
    tiles = tint(part.colour, (1 + tone) * (1 - lines))
    out.albedo[:] = np.where(gable | eaves, flat((0.60, 0.58, 0.54)), tiles)
    out.roughness[:] = 0.8


def facade(part: Part, s: Samples, out: Surface) -> None:
    """House wall: plinth, string courses, window surrounds; frames and panes in the openings."""
    assert isinstance(part.shape, House)
    grid = part.shape.openings
    x, y, _ = s.position
    fx, fy, _ = s.footprint
    base = _masonry(part, s)
    up = y - grid.base
    pale: Point = (0.66, 0.64, 0.59)
    front = s.face == 0
    band = stripes(up - grid.storey + 0.02, grid.storey, 0.14, fy) * (up > 1.5)
    base = mix(base, pale, 0.75 * band * front)
    base = mix(base, (0.27, 0.26, 0.25), span(up, -1, 0.45, fy))
    x0, x1, y0, y1, _ = grid.around(x, y)
    surround = span(x, x0 - 0.11, x1 + 0.11, fx) * span(y, y0 - 0.10, y1 + 0.16, fy)
    base = mix(base, pale, 0.85 * surround * front)
    base = mix(base, pale, (s.face > GLASS) * 0.9)
    out.albedo[:] = base
    out.openness[:] = 0.55 + 0.45 * smoothstep(-0.2, 3.0, up)
    out.openness[s.face > GLASS] *= 0.7
    pane = np.flatnonzero(s.face == GLASS)
    if pane.size:
        _panes(part, grid, pane, s, (x0, x1, y0, y1), out)


def _panes(part: Part, grid: Openings, pane: Array, s: Samples, edges: tuple[Array, ...], out: Surface) -> None:
    """Windows with white frames, a cross bar and curtains; a panelled door."""
    x, y, _ = s.position[:, pane]
    fx, fy, _ = s.footprint[:, pane]
    x0, x1, y0, y1 = (e[pane] for e in edges)
    u, v = (x - x0) / (x1 - x0), (y - y0) / (y1 - y0)
    frame = 1 - span(x, x0 + 0.07, x1 - 0.07, fx) * span(y, y0 + 0.07, y1 - 0.07, fy)
    middle = (x0 + x1) / 2
    bars = np.maximum(span(x, middle - 0.03, middle + 0.03, fx), span(v, 0.66, 0.70, fy / (y1 - y0)))
    bay, floor = cell((x - grid.start) / grid.pitch), cell((y - grid.base) / grid.storey)
    curtain = (np.abs(u - 0.5) > 0.18 + 0.3 * cell_value(bay, floor, part.seed)) * (
        cell_value(bay, floor, part.seed + 5) < 0.7
    )
    blind = v > 0.45 + 0.55 * cell_value(bay, floor, part.seed + 9)
    glass = mix(
        flat((0.025, 0.03, 0.035)),
        (0.34, 0.32, 0.28),
        np.maximum(curtain, 0.8 * blind) * 0.8,
    )
    wood = np.maximum(frame, bars)
    window = mix(glass, (0.70, 0.70, 0.68), wood)
    is_door = (bay == grid.door) & (floor == 0)
    panel = 1 - 0.35 * (np.abs(np.abs(u - 0.5) - 0.22) < 0.03) - 0.3 * ((v % 0.33) < 0.03)
    doors: tuple[Point, ...] = ((0.10, 0.03, 0.03), (0.03, 0.09, 0.06), (0.03, 0.05, 0.13), (0.16, 0.09, 0.05))
    door = tint(doors[part.seed % 4], panel)
    light = is_door & (v > 0.80) & (frame < 0.5)
    out.albedo[:, pane] = np.where(is_door & ~light, door, window)
    out.roughness[pane] = np.where((wood > 0.5) | (is_door & ~light), 0.5, 0.06)
    out.openness[pane] *= 0.75


def _masonry(part: Part, s: Samples) -> Array:
    """Brick (odd seeds) or plaster (even), along whichever way the wall runs."""
    along_x = np.abs(s.normal[2]) > 0.5
    along = np.where(along_x, s.position[0], s.position[2])
    fa = np.where(along_x, s.footprint[0], s.footprint[2])
    y, fy = s.position[1], s.footprint[1]
    if part.seed % 2:
        return _bricks(along, y, fa, fy, part.colour, part.seed % 97)
    return _plaster(along, y, fa, part.colour, part.seed % 97)


def _bricks(along: Array, y: Array, fa: Array, fy: Array, colour: Point, seed: int) -> Array:
    """Running bond with pale joints; (3, N)."""
    course = cell(y / 0.075)
    shift = along + 0.11 * (course & 1)
    tone = cell_value(cell(shift / 0.22), course, seed) - 0.5
    tone = tone * fade(0.22, fa) * fade(0.075, fy) + 0.5 * (fractal_noise(along / 2, y / 2, 3, seed + 1) - 0.5)
    joint = 1 - (1 - stripes(shift, 0.22, 0.012, fa)) * (1 - stripes(y, 0.075, 0.012, fy))
    return mix(tint(colour, 1 + 0.55 * tone), (0.45, 0.42, 0.38), joint)


def _plaster(along: Array, y: Array, fa: Array, colour: Point, seed: int) -> Array:
    """Painted plaster: faint clouds, rain streaks and grain; (3, N)."""
    shade = 1 + 0.16 * (fractal_noise(along / 1.8, y / 1.8, 3, seed) - 0.5)
    shade -= 0.22 * np.maximum(0, value_noise(along / 0.35, y / 5, seed + 1) - 0.55)
    shade += 0.10 * (value_noise(along / 0.04, y / 0.04, seed + 2) - 0.5) * fade(0.04, fa)
    return tint(colour, shade)
