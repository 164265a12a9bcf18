"""Trees and hedges: trunks, branches and clusters of leafy shells."""

from __future__ import annotations

import math
from random import Random

from aw4d.street.parts import Material, Part
from aw4d.street.shapes import Leaves, Point, rod

GREENS: tuple[Point, ...] = ((0.11, 0.20, 0.045), (0.14, 0.23, 0.05), (0.09, 0.17, 0.05), (0.18, 0.24, 0.055))


CLUMPS = 30  # shells of a crown


def tree(foot: Point, random: Random) -> list[Part]:
    """A street tree: trunk, four branches, and a crown of overlapping shells."""
    x, y, z = foot
    height = random.uniform(5.6, 6.8)
    crown = (x + random.uniform(-0.3, 0.3), y + height, z)
    spread, rise = random.uniform(2.1, 2.7), random.uniform(2.2, 2.9)
    colour = random.choice(GREENS)
    fork = (x, y + height - 0.75 * rise, z)
    parts = [_wood(foot, (x, fork[1] + 0.3, z), random.uniform(0.14, 0.2), random)]
    for number in range(4):
        angle = number * math.pi / 2 + random.uniform(-0.5, 0.5)
        end = (
            x + 0.6 * spread * math.cos(angle),
            crown[1] + random.uniform(-0.1, 0.5),
            z + 0.6 * spread * math.sin(angle),
        )
        parts.append(_wood(fork, end, 0.07, random))
    for number in range(CLUMPS):
        parts.append(_clump(number, CLUMPS, crown, (spread, rise, spread), colour, random))
    return parts


def _wood(start: Point, end: Point, radius: float, random: Random) -> Part:
    return Part(
        shape=rod(start, end, radius), material=Material.BARK, colour=(0.13, 0.10, 0.075), seed=random.randrange(999)
    )


def _clump(number: int, count: int, crown: Point, radii: Point, colour: Point, random: Random) -> Part:
    """One shell; the shells are spread over the crown on a spiral (Vogel 1979), so that none is left bald."""
    up = 1 - 2 * (number + 0.5) / count
    angle = number * math.pi * (3 - math.sqrt(5)) + random.uniform(-0.3, 0.3)
    ring = math.sqrt(1 - up * up)
    reach = random.uniform(0.5, 0.95)
    centre = (
        crown[0] + reach * radii[0] * ring * math.cos(angle),
        crown[1] + reach * radii[1] * up,
        crown[2] + reach * radii[2] * ring * math.sin(angle),
    )
    size = random.uniform(0.65, 1.1)
    shade = random.uniform(0.85, 1.2)
    seed = random.randrange(9999)
    shell = Leaves(centre, (size, 0.75 * size, size), 0.065, seed)
    tint = (colour[0] * shade, colour[1] * shade, colour[2] * shade)
    return Part(shape=shell, material=Material.LEAVES, colour=tint, origin=crown, size=radii, seed=seed)


def hedge(x0: float, x1: float, z: float, ground: float, random: Random) -> list[Part]:
    """A clipped hedge: a row of low shells."""
    count = max(2, round((x1 - x0) / 1.1))
    parts = []
    for number in range(count):
        centre = (x0 + (number + 0.5) * (x1 - x0) / count, ground + 0.45, z)
        seed = random.randrange(9999)
        shell = Leaves(centre, (0.85, 0.62, 0.5), 0.07, seed)
        middle = (centre[0], ground + 0.2, z)
        parts.append(
            Part(
                shape=shell,
                material=Material.LEAVES,
                colour=(0.07, 0.14, 0.03),
                origin=middle,
                size=(0.85, 0.7, 0.5),
                seed=seed,
            )
        )
    return parts
