"""Samples on a part, the surface that is painted onto them, and colours.

A painter gets a part and its samples and fills in their surface.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from aw4d.street.shapes import Point

Array = NDArray[Any]


@dataclass(frozen=True)
class Samples:
    """Points on one part: world position [m], world normal, footprint along the world axes [m], face."""

    position: Array  # (3, N)
    normal: Array  # (3, N)
    footprint: Array  # (3, N)
    face: Array  # (N,)


class Surface(NamedTuple):
    """What is known of surface points: (3, N) or (N,), filled in place by the painters."""

    albedo: Array
    roughness: Array
    metallic: Array
    emissive: Array
    openness: Array  # share of the sky that is seen


def blank(count: int) -> Surface:
    """Black, dull surfaces, to be painted."""
    return Surface(
        np.zeros((3, count), np.float32),
        np.ones(count, np.float32),
        np.zeros(count, np.float32),
        np.zeros((3, count), np.float32),
        np.ones(count, np.float32),
    )


def flat(colour: Point) -> Array:
    """One colour for all samples, (3, 1)."""
    return np.array(colour, np.float32)[:, None]


def tint(colour: Point, shade: Array) -> Array:
    """Colour times shade, (3, N)."""
    return flat(colour) * shade


def mix(base: Array, colour: Point, share: Array) -> Array:
    """Blend towards a colour."""
    return base + (flat(colour) - base) * share
