"""Painters of cars: body, cabin, wheels."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from aw4d.street.cars import BELT, HALF_LENGTH, HALF_WIDTH, STYLES, WHEEL_RADIUS, WHEEL_X
from aw4d.street.noise import cell, cell_value, smoothstep
from aw4d.street.parts import Part
from aw4d.street.shapes import Point
from aw4d.street.surface import Samples, Surface, flat

Array = NDArray[Any]


def _template(part: Part, s: Samples) -> tuple[Array, Array, Array]:
    """Position on the car's template."""
    x = (s.position[0] - part.origin[0]) * part.heading / part.size[0]
    y = s.position[1] / part.size[1]
    z = (s.position[2] - part.origin[2]) * part.heading / part.size[2]
    return x, y, z


def body(part: Part, s: Samples, out: Surface) -> None:
    """Painted metal with door gaps, handles, wheel arches, bumpers, lamps, grille and number plate."""
    x, y, z = _template(part, s)
    style = STYLES[part.seed]
    out.albedo[:] = flat(part.colour)
    out.roughness[:] = 0.28

    def paint(where: Array, colour: Point, roughness: float) -> None:
        out.albedo[:, where] = flat(colour)
        out.roughness[where] = roughness

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
    out.openness[:] = 0.35 + 0.65 * smoothstep(0.1, 0.7, y)


def cabin(part: Part, s: Samples, out: Surface) -> None:
    """Windows between painted pillars under a painted roof."""
    x, y, z = _template(part, s)
    style = STYLES[part.seed]
    share = np.clip((y - BELT) / (style.roof - BELT), 0, 1)
    screen = style.screen_foot + (style.screen_top - style.screen_foot) * share
    rear = style.rear_foot + (style.rear_top - style.rear_foot) * share
    half = 0.79 - 0.17 * share
    side = np.abs(s.normal[2]) > 0.6
    pillar = (style.screen_top + style.rear_top) / 2 + 0.05
    flank = (
        side
        & (screen - x > 0.10)
        & (x - rear > 0.14)
        & (np.abs(x - pillar) > 0.05)
        & (np.abs(x - style.rear_top) > 0.04)
    )
    ends = ~side & (s.normal[1] < 0.93) & (half - np.abs(z) > 0.07)
    glass = (flank | ends) & (y > BELT + 0.035) & (y < style.roof - 0.085)
    rest = np.hypot(np.abs(z) - 0.34, np.maximum(y - BELT - 0.10, 0)) < 0.095  # head rests behind the screens
    inside = np.where(ends & rest, 0.014, 0.03 + 0.05 * smoothstep(BELT + 0.35, BELT, y))
    out.albedo[:] = np.where(glass, inside, flat(part.colour))
    out.roughness[:] = np.where(glass, 0.05, 0.28)


def wheel(part: Part, s: Samples, out: Surface) -> None:
    """Tyre, and a light-metal rim with five spokes."""
    x, y, _ = _template(part, s)
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
