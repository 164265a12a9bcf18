"""Painters of small things: metal, bark, leaves, signals, signs, lamp heads."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from aw4d.street.noise import fractal_noise, smoothstep
from aw4d.street.parts import Part
from aw4d.street.shapes import Leaves, Point, leaf_value
from aw4d.street.surface import Samples, Surface, flat, tint

Array = NDArray[Any]


def metal(part: Part, s: Samples, out: Surface) -> None:
    """Painted metal."""
    out.albedo[:] = flat(part.colour)
    out.roughness[:] = 0.4


def bark(part: Part, s: Samples, out: Surface) -> None:
    """Bark: grain along the trunk, with patches."""
    x, y, z = s.position
    shade = 0.65 + 0.7 * fractal_noise((x + 0.7 * z) / 0.06, y / 0.35, 2, part.seed % 90)
    out.albedo[:] = tint(part.colour, shade)
    out.openness[:] = 0.75


def leaves(part: Part, s: Samples, out: Surface) -> None:
    """Leaves of many greens; the inside of the crown sees little sky."""
    assert isinstance(part.shape, Leaves)
    x, y, z = s.position
    lattice = leaf_value((x, y, z), part.shape.leaf, part.seed)
    fine = leaf_value((x, y, z), part.shape.leaf * 0.5, part.seed + 3)
    shade = 0.45 + 0.8 * lattice + 0.35 * fine
    hue = flat((0.35, 0.10, 0.0)) * (fine - 0.5)
    out.albedo[:] = tint(part.colour, shade) * (1 + hue)
    inner = [(c - o) / r for c, o, r in zip((x, y, z), part.origin, part.size, strict=True)]
    reach = np.sqrt(inner[0] ** 2 + inner[1] ** 2 + inner[2] ** 2)
    out.openness[:] = np.clip(0.15 + 0.85 * smoothstep(0.35, 1.35, reach) * (0.75 + 0.25 * inner[1]), 0.1, 1)
    out.roughness[:] = 0.75


def signal(part: Part, s: Samples, out: Surface) -> None:
    """Black housing with a red, an amber and a green lens; green is lit."""
    _, y, z = s.position - flat(part.origin)
    out.albedo[:] = flat(part.colour)
    out.roughness[:] = 0.5
    front = s.normal[0] * part.heading > 0.5
    lenses: tuple[tuple[float, Point, float], ...] = (
        (0.29, (0.20, 0.015, 0.01), 0.0),
        (0.0, (0.22, 0.10, 0.01), 0.0),
        (-0.29, (0.02, 0.22, 0.12), 1.0),
    )
    for height, colour, lit in lenses:
        lens = front & (np.hypot(y - height, z) < 0.105)
        out.albedo[:, lens] = flat(colour)
        out.emissive[:, lens] = lit * flat((0.05, 1.6, 0.85))


def sign(part: Part, s: Samples, out: Surface) -> None:
    """Round no-stopping sign, to be read against the traffic's way; grey behind."""
    _, y, z = s.position - flat(part.origin)
    radius = np.hypot(y, z) / part.size[0]
    front = s.normal[0] * part.heading > 0.5
    bar = np.minimum(np.abs(y - z), np.abs(y + z)) < 0.10 * part.size[0]
    red = (radius > 0.84) | bar
    face = np.where(red, flat((0.55, 0.02, 0.02)), flat((0.03, 0.10, 0.45)))
    out.albedo[:] = np.where(front, face, 0.35)
    out.roughness[:] = 0.5


def lamp_head(part: Part, s: Samples, out: Surface) -> None:
    """Grey housing, pale glass below."""
    below = s.normal[1] < -0.2
    out.albedo[:] = np.where(below, 0.7, flat(part.colour))
    out.roughness[:] = 0.35
