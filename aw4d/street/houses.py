"""Houses: a front with recessed windows and a door, a roof, chimneys, dormers."""

from __future__ import annotations

import math
from dataclasses import replace
from random import Random

from aw4d.street.parts import Material, Part
from aw4d.street.shapes import House, Openings, Point, Solid, box, box_planes

DEPTH = 9.0  # of a house, from the street inwards [m]
STOREY = 3.0
PLASTERS: tuple[Point, ...] = (
    (0.72, 0.68, 0.58),
    (0.70, 0.58, 0.40),
    (0.62, 0.66, 0.66),
    (0.68, 0.50, 0.40),
    (0.76, 0.75, 0.71),
    (0.55, 0.62, 0.52),
)
BRICKS: tuple[Point, ...] = ((0.34, 0.13, 0.085), (0.40, 0.19, 0.12), (0.30, 0.15, 0.11), (0.46, 0.32, 0.21))
STONE: Point = (0.60, 0.58, 0.53)
TILES: tuple[Point, ...] = ((0.30, 0.11, 0.07), (0.16, 0.15, 0.155), (0.22, 0.13, 0.09))


def house(x0: float, x1: float, side: int, front: float, ground: float, random: Random) -> list[Part]:
    """One house of a row.

    Parameters
    ----------
    x0, x1
        Its ends along the road [m].
    side, front
        Side of the road (+1 right) and distance of its front from the middle of the road [m].
    ground
        World y of the pavement [m].
    random
        Source of its looks.
    """
    floors = random.choices((2, 3, 4), (5, 5, 1))[0]
    eaves = ground + 0.35 + floors * STOREY + 0.25
    bays = max(2, round((x1 - x0) / random.uniform(2.2, 2.9)))
    openings = Openings(
        start=x0 + 0.2,
        base=ground + 0.15,
        pitch=(x1 - x0 - 0.4) / bays,
        storey=STOREY,
        bays=bays,
        floors=floors,
        width=random.uniform(0.95, 1.3),
        height=random.uniform(1.4, 1.75),
        sill=0.85,
        door=random.randrange(bays),
        recess=random.uniform(0.12, 0.2),
    )
    brick = random.random() < 0.42
    colour = random.choice(BRICKS if brick else PLASTERS)
    seed = random.randrange(1000) * 2 + brick
    z = side * front
    low, high = (x0, 0.0, min(z, z + side * DEPTH)), (x1, eaves, max(z, z + side * DEPTH))
    parts = [_walls(low, high, side, openings, colour, seed)]
    parts += _roof(low, high, side, seed, colour, random)
    return parts + _front_extras(openings, z, side, colour, seed, random)


def _walls(low: Point, high: Point, side: int, openings: Openings, colour: Point, seed: int) -> Part:
    """A box whose street front has openings; odd seeds are brick."""
    planes = box_planes(low, high)
    shape = House((low, high), (planes[4 if side > 0 else 5], *planes), openings=openings)
    return Part(shape=shape, material=Material.FACADE, colour=colour, seed=seed)


def _front_extras(grid: Openings, z: float, side: int, colour: Point, seed: int, random: Random) -> list[Part]:
    """What stands out of a front: a door step, and an oriel or an awning on some."""
    door = grid.start + (grid.door + 0.5) * grid.pitch
    parts = [
        Part(shape=_block(door - 0.8, door + 0.8, 0.0, grid.base, z, side, 0.45), material=Material.WALL, colour=STONE)
    ]
    kind = random.random()
    other = (grid.door + 1 + random.randrange(grid.bays - 1)) % grid.bays
    middle = grid.start + (other + 0.5) * grid.pitch
    half = min(1.05, grid.pitch / 2 - 0.08)
    if kind < 0.45:
        foot, top = grid.base + STOREY - 0.15, grid.base + grid.floors * STOREY - 0.25
        solid = _block(middle - half, middle + half, foot, top, z, side, 0.75)
        window = replace(
            grid,
            start=middle - half,
            base=foot + 0.15,
            pitch=2 * half,
            bays=1,
            floors=grid.floors - 1,
            door=-1,
            recess=0.08,
            width=1.5 * half,
        )
        parts.append(_walls(*solid.bounds, side, window, colour, seed))
        lid = _block(middle - half - 0.1, middle + half + 0.1, top, top + 0.12, z, side, 0.85)
        parts.append(Part(shape=lid, material=Material.WALL, colour=STONE))
    elif kind < 0.75:
        parts.append(_awning(middle - half - 0.2, middle + half + 0.2, grid.base + 2.75, z, side, random))
    return parts


def _block(x0: float, x1: float, y0: float, y1: float, z: float, side: int, reach: float) -> Solid:
    """Box that stands out of a front towards the street."""
    z0, z1 = sorted((z + side * 0.02, z - side * reach))
    return box((x0, y0, z0), (x1, y1, z1))


def _awning(x0: float, x1: float, top: float, z: float, side: int, random: Random) -> Part:
    """Slanted sheet of cloth over a window: a wedge between two slanted planes."""
    reach, fall = 1.3, 0.6
    low, high = _block(x0, x1, top - fall - 0.05, top, z, side, reach).bounds
    n = math.hypot(reach, fall)
    slope: Point = (0.0, reach / n, -side * fall / n)
    offset = slope[1] * top + slope[2] * z
    planes = (*box_planes(low, high), (slope, offset), ((0.0, -slope[1], -slope[2]), 0.03 - offset))
    colour = random.choice(((0.45, 0.04, 0.03), (0.03, 0.16, 0.08), (0.04, 0.09, 0.30), (0.55, 0.32, 0.05)))
    return Part(shape=Solid((low, high), planes), material=Material.CLOTH, colour=colour)


def _roof(low: Point, high: Point, side: int, seed: int, colour: Point, random: Random) -> list[Part]:
    """A saddle roof along the road with dormers, or a flat one behind a cornice; a chimney on either."""
    eaves, middle = high[1], (low[2] + high[2]) / 2
    parts: list[Part] = []
    if random.random() < 0.75:
        slope = random.uniform(0.6, 0.9)
        ridge = eaves + slope * DEPTH / 2
        parts.append(_saddle(low, high, slope, random.choice(TILES), seed))
        for number in range(random.choice((0, 1, 2))):
            x = low[0] + (high[0] - low[0]) * (0.3 + 0.4 * number)
            parts += _dormer(x, eaves + 0.35, (low[2] if side > 0 else high[2]) + side * 0.9, side, seed)
    else:
        c_low, c_high = (low[0], eaves - 0.35, low[2] - 0.25), (high[0], eaves + 0.15, high[2] + 0.25)
        parts.append(Part(shape=box(c_low, c_high), material=Material.WALL, colour=STONE, seed=seed & ~1))
        ridge = eaves + 0.6
    x = random.choice((low[0] + 0.8, high[0] - 0.8))
    c_low, c_high = (x - 0.45, eaves, middle - 0.35), (x + 0.45, ridge + 0.9, middle + 0.35)
    parts.append(Part(shape=box(c_low, c_high), material=Material.WALL, colour=BRICKS[0], seed=seed | 1))
    return parts


def _saddle(low: Point, high: Point, slope: float, tiles: Point, seed: int) -> Part:
    """Roof prism with its ridge along the road and eaves that stand out."""
    overhang, thickness = 0.38, 0.12
    foot = high[1] - 0.08
    r_low = (low[0], foot, low[2] - overhang)
    r_high = (high[0], foot + thickness + slope * (DEPTH / 2 + overhang), high[2] + overhang)
    n = math.hypot(1.0, slope)
    planes = (
        ((0.0, 1 / n, -slope / n), (foot + thickness - slope * r_low[2]) / n),
        ((0.0, 1 / n, slope / n), (foot + thickness + slope * r_high[2]) / n),
        *box_planes(r_low, r_high),
    )
    return Part(shape=Solid((r_low, r_high), planes), material=Material.ROOF, colour=tiles, seed=seed)


def _dormer(x: float, y: float, z: float, side: int, seed: int) -> list[Part]:
    """A window in the roof: a small box with one opening under a flat lid."""
    z0, z1 = sorted((z, z + side * 2.6))
    window = Openings(
        start=x - 0.75,
        base=y,
        pitch=1.5,
        storey=1.5,
        bays=1,
        floors=1,
        width=0.95,
        height=1.1,
        sill=0.2,
        door=-1,
        recess=0.1,
    )
    walls = _walls((x - 0.75, y, z0), (x + 0.75, y + 1.5, z1), side, window, (0.66, 0.64, 0.60), seed & ~1)
    lid = box((x - 0.9, y + 1.5, z0 - 0.15), (x + 0.9, y + 1.6, z1 + 0.15))
    return [walls, Part(shape=lid, material=Material.WALL, colour=(0.2, 0.2, 0.21), seed=seed & ~1)]
