"""What the parts look like: reflectance, roughness and lights as functions of position on the part.

A painter gets the part and its samples and returns their surface. Fine patterns are averaged over the sample's
footprint, so that far brickwork and markings turn grey instead of crawling.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aw4d.street import layout
from aw4d.street.cars import BELT, HALF_LENGTH, HALF_WIDTH, STYLES, WHEEL_RADIUS, WHEEL_X
from aw4d.street.noise import cell, cell_value, fade, fractal_noise, smoothstep, span, stripes, value_noise
from aw4d.street.parts import Material, Part
from aw4d.street.shapes import GLASS, House, Leaves, Point, leaf_value

Array = NDArray[Any]


@dataclass(frozen=True)
class Samples:
    """Points on one part: world position [m], world normal, footprint along the world axes [m], face."""

    position: Array  # (3, N)
    normal: Array  # (3, N)
    footprint: Array  # (3, N)
    face: Array  # (N,)


@dataclass(frozen=True)
class Surface:
    """What is known of surface points: albedo (3, N), roughness, metallic, emissive (3, N), share of sky light."""

    albedo: Array
    roughness: Array
    metallic: Array
    emissive: Array
    openness: Array


def blank(count: int) -> Surface:
    """A dull grey surface, to be painted."""
    return Surface(
        np.full((3, count), 0.5, np.float32),
        np.full(count, 0.9, np.float32),
        np.zeros(count, np.float32),
        np.zeros((3, count), np.float32),
        np.ones(count, np.float32),
    )


def _tint(colour: Point, shade: Array | float) -> Array:
    """Colour times shade, (3, N)."""
    return np.array(colour, np.float32)[:, None] * shade


def _mix(base: Array, colour: Point, share: Array) -> Array:
    """Blend towards a colour."""
    return base + (np.array(colour, np.float32)[:, None] - base) * share


def _asphalt(part: Part, s: Samples, out: Surface) -> None:
    """Road: worn asphalt with repairs, cracks, wheel tracks, manholes and markings."""
    (x, _, z), (fx, _, fz) = s.position, s.footprint
    shade = 0.80 + 0.40 * (fractal_noise(x / 5, z / 2, 3, seed=1) - 0.5)
    shade += 0.9 * (value_noise(x / 0.014, z / 0.014, seed=2) - 0.5) * fade(0.02, fx)
    shade += 0.25 * (value_noise(x / 0.05, z / 0.05, seed=3) - 0.5) * fade(0.06, fx)
    lane = np.abs(np.abs(z) - layout.EGO_Z)
    shade += 0.10 * np.exp(-(((lane - 0.75) / 0.28) ** 2)) - 0.13 * np.exp(-((lane / 0.35) ** 2))
    shade -= 0.25 * smoothstep(layout.ROAD_HALF - 0.5, layout.ROAD_HALF, np.abs(z))
    shade *= _repairs(x, z, fx, fz) * _cracks(x, z, fx)
    base = _tint((0.205, 0.200, 0.192), np.maximum(shade, 0.1))
    paint = _markings(x, z, fx, fz)
    worn = smoothstep(0.22, 0.5, fractal_noise(x / 0.25, z / 0.12, 2, seed=7) + 0.10)
    out.albedo[:] = _mix(base, (0.68, 0.67, 0.63), paint * (0.35 + 0.6 * worn))
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
    ring = smoothstep(0.40, 0.37, lid) * (0.35 + 0.35 * smoothstep(0.33, 0.30, lid) * smoothstep(0.2, 0.9, np.sin(u * 60)))
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
    paint += span(away, edge + 0.9, edge + 3.8, fx) * stripes(z + 0.25, 1.0, 0.5, fz) * (np.abs(z) < layout.ROAD_HALF - 0.25)
    return np.minimum(paint, 1)


def _pavement(part: Part, s: Samples, out: Surface) -> None:
    """Slabs, kerb stones, tree pits, and lawn behind the house fronts."""
    (x, _, z), (fx, _, fz) = s.position, s.footprint
    across = np.abs(z) - layout.ROAD_HALF
    i, j = cell(x / 0.8), cell(across / 0.6)
    slab = 0.90 + 0.16 * (cell_value(i, j, 41) - 0.5) * fade(0.8, fx) + 0.3 * (fractal_noise(x / 3, z / 1.5, 3, 42) - 0.5)
    slab += 0.25 * (value_noise(x / 0.02, z / 0.02, 44) - 0.5) * fade(0.03, fx)
    joint = 1 - (1 - stripes(x, 0.8, 0.012, fx)) * (1 - stripes(across, 0.6, 0.012, fz))
    base = _tint((0.40, 0.385, 0.36), slab * (1 - 0.55 * joint))
    kerb = span(across, -1, 0.16, fz) if s.face.size else across
    side = s.face != 3
    stone = _tint((0.47, 0.46, 0.44), 1 + 0.25 * (fractal_noise(x / 0.7, z / 0.7, 2, 45) - 0.5) - 0.5 * stripes(x, 1.0, 0.012, fx))
    base += (stone - base) * np.where(side, 1, kerb)
    start = part.origin[0] + 9 + np.where(z > 0, 4.0, 0.0)
    from_tree = np.abs((x - start + 6) % 12 - 6)
    pit = span(from_tree, -1, 0.6, fx) * span(np.abs(across - 1.2), -1, 0.6, fz)
    base = _mix(base, (0.09, 0.07, 0.05), pit * (0.8 + 0.2 * value_noise(x / 0.1, z / 0.1, 46)))
    lawn = smoothstep(3.72, 3.74, across) * (fractal_noise(x / 4, z / 4, 3, 47) * 0.6 + 0.7)
    out.albedo[:] = np.where(across > 3.73, _tint((0.09, 0.15, 0.035), lawn), base)
    out.roughness[:] = 0.9


def _bricks(along: Array, y: Array, fa: Array, fy: Array, colour: Point, seed: int) -> Array:
    """Running bond with pale joints; (3, N)."""
    course = cell(y / 0.075)
    shift = along + 0.11 * (course & 1)
    tone = cell_value(cell(shift / 0.22), course, seed) - 0.5
    tone = tone * fade(0.22, fa) * fade(0.075, fy) + 0.5 * (fractal_noise(along / 2, y / 2, 3, seed + 1) - 0.5)
    joint = 1 - (1 - stripes(shift, 0.22, 0.012, fa)) * (1 - stripes(y, 0.075, 0.012, fy))
    return _mix(_tint(colour, 1 + 0.55 * tone), (0.45, 0.42, 0.38), joint)


def _plaster(along: Array, y: Array, fa: Array, colour: Point, seed: int) -> Array:
    """Painted plaster: faint clouds, rain streaks and grain; (3, N)."""
    shade = 1 + 0.16 * (fractal_noise(along / 1.8, y / 1.8, 3, seed) - 0.5)
    shade -= 0.22 * np.maximum(0, value_noise(along / 0.35, y / 5, seed + 1) - 0.55)
    shade += 0.10 * (value_noise(along / 0.04, y / 0.04, seed + 2) - 0.5) * fade(0.04, fa)
    return _tint(colour, shade)


def _masonry(part: Part, s: Samples) -> Array:
    """Brick (odd seeds) or plaster (even), along whichever way the wall runs."""
    along_x = np.abs(s.normal[2]) > 0.5
    along = np.where(along_x, s.position[0], s.position[2])
    fa = np.where(along_x, s.footprint[0], s.footprint[2])
    y, fy = s.position[1], s.footprint[1]
    if part.seed % 2:
        return _bricks(along, y, fa, fy, part.colour, part.seed % 97)
    return _plaster(along, y, fa, part.colour, part.seed % 97)


def _cloth(part: Part, s: Samples, out: Surface) -> None:
    """Striped awning."""
    x, fx = s.position[0], s.footprint[0]
    stripe = stripes(x, 0.5, 0.25, fx)
    out.albedo[:] = _mix(_tint(part.colour, np.ones(x.size, np.float32)), (0.72, 0.70, 0.66), stripe)


def _wall(part: Part, s: Samples, out: Surface) -> None:
    """Masonry without openings."""
    out.albedo[:] = _masonry(part, s)


def _facade(part: Part, s: Samples, out: Surface) -> None:
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
    base = _mix(base, pale, 0.75 * band * front)
    base = _mix(base, (0.27, 0.26, 0.25), span(up, -1, 0.45, fy))
    x0, x1, y0, y1, _ = grid.around(x, y)
    surround = span(x, x0 - 0.11, x1 + 0.11, fx) * span(y, y0 - 0.10, y1 + 0.16, fy)
    base = _mix(base, pale, 0.85 * surround * front)
    base = _mix(base, pale, (s.face > GLASS) * 0.9)
    out.albedo[:] = base
    out.openness[:] = 0.55 + 0.45 * smoothstep(-0.2, 3.0, up)
    out.openness[s.face > GLASS] *= 0.7
    pane = np.flatnonzero(s.face == GLASS)
    if pane.size:
        _panes(part, grid, pane, s, (x0, x1, y0, y1), out)


def _panes(part: Part, grid: Any, pane: Array, s: Samples, edges: tuple[Array, ...], out: Surface) -> None:
    """Windows with white frames, a cross bar and curtains; a panelled door."""
    x, y, _ = s.position[:, pane]
    fx, fy, _ = s.footprint[:, pane]
    x0, x1, y0, y1 = (e[pane] for e in edges)
    u, v = (x - x0) / (x1 - x0), (y - y0) / (y1 - y0)
    frame = 1 - span(x, x0 + 0.07, x1 - 0.07, fx) * span(y, y0 + 0.07, y1 - 0.07, fy)
    middle = (x0 + x1) / 2
    bars = np.maximum(span(x, middle - 0.03, middle + 0.03, fx), span(v, 0.66, 0.70, fy / (y1 - y0)))
    bay, floor = cell((x - grid.start) / grid.pitch), cell((y - grid.base) / grid.storey)
    curtain = (np.abs(u - 0.5) > 0.18 + 0.3 * cell_value(bay, floor, part.seed)) * (cell_value(bay, floor, part.seed + 5) < 0.7)
    blind = v > 0.45 + 0.55 * cell_value(bay, floor, part.seed + 9)
    glass = _mix(_tint((0.025, 0.03, 0.035), np.ones(x.size, np.float32)), (0.34, 0.32, 0.28), np.maximum(curtain, 0.8 * blind) * 0.8)
    wood = np.maximum(frame, bars)
    window = _mix(glass, (0.70, 0.70, 0.68), wood)
    is_door = (bay == grid.door) & (floor == 0)
    panel = 1 - 0.35 * (np.abs(np.abs(u - 0.5) - 0.22) < 0.03) - 0.3 * ((v % 0.33) < 0.03)
    doors: tuple[Point, ...] = ((0.10, 0.03, 0.03), (0.03, 0.09, 0.06), (0.03, 0.05, 0.13), (0.16, 0.09, 0.05))
    door = _tint(doors[part.seed % 4], panel)
    light = is_door & (v > 0.80) & (frame < 0.5)
    out.albedo[:, pane] = np.where(is_door & ~light, door, window)
    out.roughness[pane] = np.where((wood > 0.5) | (is_door & ~light), 0.5, 0.06)
    out.openness[pane] *= 0.75


def _roof(part: Part, s: Samples, out: Surface) -> None:
    """Rows of tiles up the slope."""
    (x, y, _), (fx, fy, _) = s.position, s.footprint
    row = cell(y / 0.19)
    shift = x + 0.12 * (row & 1)
    tone = (cell_value(cell(shift / 0.24), row, part.seed) - 0.5) * fade(0.24, fx) * fade(0.19, fy)
    tone = 0.45 * tone + 0.4 * (fractal_noise(x / 2.5, y / 2.5, 3, part.seed) - 0.5)
    lines = np.maximum(0.45 * stripes(y, 0.19, 0.03, fy), 0.3 * stripes(shift, 0.24, 0.02, fx))
    gable = np.abs(s.normal[0]) > 0.5
    eaves = s.normal[1] < 0.1
    tiles = _tint(part.colour, (1 + tone) * (1 - lines))
    out.albedo[:] = np.where(gable | eaves, _tint((0.60, 0.58, 0.54), np.ones(x.size, np.float32)), tiles)
    out.roughness[:] = 0.8


def _template(part: Part, s: Samples) -> tuple[Array, Array, Array]:
    """Position on the car's template."""
    x = (s.position[0] - part.origin[0]) * part.heading / part.size[0]
    y = s.position[1] / part.size[1]
    z = (s.position[2] - part.origin[2]) * part.heading / part.size[2]
    return x, y, z


def _car_body(part: Part, s: Samples, out: Surface) -> None:
    """Painted metal with door gaps, handles, wheel arches, bumpers, lamps, grille and number plate."""
    x, y, z = _template(part, s)
    style = STYLES[part.seed]
    albedo = _tint(part.colour, np.ones(x.size, np.float32))
    gloss = np.full(x.size, 0.28, np.float32)

    def paint(where: Array, colour: Point, roughness: float) -> None:
        albedo[:, where] = np.array(colour, np.float32)[:, None]
        gloss[where] = roughness

    wide = np.abs(z)
    flank = wide > HALF_WIDTH - 0.12
    ends = np.abs(x) > HALF_LENGTH - 0.30
    black: Point = (0.018, 0.018, 0.02)
    for gap in (style.screen_foot - 0.15, (style.screen_top + style.rear_top) / 2 + 0.05, style.rear_top - 0.08):
        paint(flank & (np.abs(x - gap) < 0.012) & (y > 0.32), black, 0.7)
        paint(flank & (np.abs(x - gap - 0.16) < 0.09) & (np.abs(y - 0.80) < 0.018), (0.3, 0.3, 0.3), 0.2)
    paint(y < 0.30, black, 0.7)
    arch = np.hypot(np.abs(x) - WHEEL_X, y - WHEEL_RADIUS) < WHEEL_RADIUS + 0.06
    paint(arch & flank, (0.006, 0.006, 0.006), 0.9)
    front, rear = ends & (x > 0), ends & (x < 0)
    low = style.hood - 0.24
    paint(front & (wide < 0.52) & (y > low - 0.06) & (y < low + 0.13), black, 0.5)
    paint(front & (wide < 0.62) & (y > 0.30) & (y < 0.42), black, 0.6)
    paint(front & (wide > 0.53) & (y > low + 0.01) & (y < low + 0.16), (0.75, 0.78, 0.80), 0.08)
    paint(rear & (np.abs(y - 0.47) < 0.035), black, 0.6)
    paint(rear & (wide > 0.50) & (y > 0.63) & (y < 0.82), (0.42, 0.012, 0.012), 0.12)
    paint(rear & (wide > 0.56) & (wide < 0.70) & (y > 0.64) & (y < 0.69), (0.62, 0.58, 0.55), 0.12)
    paint(rear & (np.abs(z) < 0.60) & (np.abs(y - 0.885) < 0.008), black, 0.7)
    plate = np.where(x > 0, 0.43, 0.66)
    paint(ends & (wide < 0.26) & (np.abs(y - plate) < 0.055), (0.62, 0.62, 0.58), 0.5)
    letters = (np.abs(y - plate) < 0.032) & (cell_value(cell(z / 0.022), cell(x * 0), 50 + part.vehicle % 50) < 0.55)
    paint(ends & (wide < 0.22) & letters, (0.03, 0.03, 0.04), 0.5)
    out.albedo[:], out.roughness[:] = albedo, gloss
    out.openness[:] = 0.35 + 0.65 * smoothstep(0.1, 0.7, y)


def _car_cabin(part: Part, s: Samples, out: Surface) -> None:
    """Windows between painted pillars under a painted roof."""
    x, y, z = _template(part, s)
    style = STYLES[part.seed]
    share = np.clip((y - BELT) / (style.roof - BELT), 0, 1)
    screen = style.screen_foot + (style.screen_top - style.screen_foot) * share
    rear = style.rear_foot + (style.rear_top - style.rear_foot) * share
    half = 0.79 - 0.17 * share
    side = np.abs(s.normal[2]) > 0.6
    pillar = (style.screen_top + style.rear_top) / 2 + 0.05
    flank = side & (screen - x > 0.10) & (x - rear > 0.14) & (np.abs(x - pillar) > 0.05) & (np.abs(x - style.rear_top) > 0.04)
    ends = ~side & (s.normal[1] < 0.93) & (half - np.abs(z) > 0.07)
    glass = (flank | ends) & (y > BELT + 0.035) & (y < style.roof - 0.085)
    rest = np.hypot(np.abs(z) - 0.36, np.maximum(y - BELT - 0.12, 0)) < 0.13  # head rests behind the screens
    inside = np.where(ends & rest, 0.008, 0.03 + 0.05 * smoothstep(BELT + 0.35, BELT, y))
    out.albedo[:] = np.where(glass, inside, _tint(part.colour, np.ones(x.size, np.float32)))
    out.roughness[:] = np.where(glass, 0.05, 0.28)


def _wheel(part: Part, s: Samples, out: Surface) -> None:
    """Tyre, and a light-metal rim with five spokes."""
    x, y, z = _template(part, s)
    side = np.abs(s.normal[2]) > 0.5
    u, v = np.abs(x) - WHEEL_X, y - WHEEL_RADIUS
    radius, angle = np.hypot(u, v), np.arctan2(v, u)
    spoke = (np.cos(5 * angle + part.vehicle) > -0.15) | (radius < 0.06)
    rim = side & (radius < 0.215)
    metal = rim & (spoke | (radius > 0.19))
    out.albedo[:] = np.where(metal, 0.55, np.where(rim, 0.015, 0.028)).astype(np.float32)
    out.roughness[:] = np.where(metal, 0.35, 0.9)
    out.metallic[:] = metal
    out.openness[:] = 0.5


def _metal(part: Part, s: Samples, out: Surface) -> None:
    """Painted metal."""
    out.albedo[:] = _tint(part.colour, np.ones(s.face.size, np.float32))
    out.roughness[:] = 0.4


def _bark(part: Part, s: Samples, out: Surface) -> None:
    """Bark: grain along the trunk, with patches."""
    x, y, z = s.position
    shade = 0.65 + 0.7 * fractal_noise((x + 0.7 * z) / 0.06, y / 0.35, 2, part.seed % 90)
    out.albedo[:] = _tint(part.colour, shade)
    out.openness[:] = 0.75


def _leaves(part: Part, s: Samples, out: Surface) -> None:
    """Leaves of many greens; the inside of the crown sees little sky."""
    assert isinstance(part.shape, Leaves)
    x, y, z = s.position
    lattice = leaf_value((x, y, z), part.shape.leaf, part.seed)
    fine = leaf_value((x, y, z), part.shape.leaf * 0.5, part.seed + 3)
    shade = 0.45 + 0.8 * lattice + 0.35 * fine
    warm = np.array([1.0 + 0.0, 1.0, 1.0], np.float32)[:, None] + np.array([0.35, 0.1, 0.0], np.float32)[:, None] * (fine - 0.5)
    out.albedo[:] = np.clip(_tint(part.colour, shade) * warm, 0, 1)
    inner = [(c - o) / r for c, o, r in zip((x, y, z), part.origin, part.size, strict=True)]
    reach = np.sqrt(inner[0] ** 2 + inner[1] ** 2 + inner[2] ** 2)
    out.openness[:] = np.clip(0.15 + 0.85 * smoothstep(0.35, 1.35, reach) * (0.75 + 0.25 * inner[1]), 0.1, 1)
    out.roughness[:] = 0.75


def _signal(part: Part, s: Samples, out: Surface) -> None:
    """Black housing with a red, an amber and a green lens; green is lit."""
    _, y, z = s.position - np.array(part.origin, np.float32)[:, None]
    out.albedo[:] = _tint(part.colour, np.ones(y.size, np.float32))
    out.roughness[:] = 0.5
    front = s.normal[0] * part.heading > 0.5
    lenses: tuple[tuple[float, Point, float], ...] = (
        (0.29, (0.20, 0.015, 0.01), 0.0),
        (0.0, (0.22, 0.10, 0.01), 0.0),
        (-0.29, (0.02, 0.22, 0.12), 1.0),
    )
    for height, colour, lit in lenses:
        lens = front & (np.hypot(y - height, z) < 0.105)
        out.albedo[:, lens] = np.array(colour, np.float32)[:, None]
        out.emissive[:, lens] = lit * np.array([[0.05], [1.6], [0.85]], np.float32)


def _sign(part: Part, s: Samples, out: Surface) -> None:
    """Round no-stopping sign, to be read against the traffic's way; grey behind."""
    _, y, z = s.position - np.array(part.origin, np.float32)[:, None]
    radius = np.hypot(y, z) / part.size[0]
    front = s.normal[0] * part.heading > 0.5
    bar = np.minimum(np.abs(y - z), np.abs(y + z)) < 0.10 * part.size[0]
    red = (radius > 0.84) | bar
    face = np.where(red, np.array([[0.55], [0.02], [0.02]]), np.array([[0.03], [0.10], [0.45]]))
    out.albedo[:] = np.where(front, face, 0.35)
    out.roughness[:] = 0.5


def _lamp_head(part: Part, s: Samples, out: Surface) -> None:
    """Grey housing, pale glass below."""
    below = s.normal[1] < -0.2
    out.albedo[:] = np.where(below, 0.7, _tint(part.colour, np.ones(s.face.size, np.float32)))
    out.roughness[:] = 0.35


Painter = Callable[[Part, Samples, Surface], None]
PAINTERS: dict[Material, Painter] = {
    Material.ASPHALT: _asphalt,
    Material.PAVEMENT: _pavement,
    Material.FACADE: _facade,
    Material.WALL: _wall,
    Material.CLOTH: _cloth,
    Material.ROOF: _roof,
    Material.CAR_BODY: _car_body,
    Material.CAR_CABIN: _car_cabin,
    Material.WHEEL: _wheel,
    Material.METAL: _metal,
    Material.BARK: _bark,
    Material.LEAVES: _leaves,
    Material.SIGNAL: _signal,
    Material.SIGN: _sign,
    Material.LAMP_HEAD: _lamp_head,
}
