"""A part of the street: a shape, what it is made of, and what it belongs to."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, auto

from aw4d.street.shapes import Point, Shape


class Material(IntEnum):
    """What a part is made of; `textures.PAINTERS` has a function for each."""

    ASPHALT = auto()
    PAVEMENT = auto()
    FACADE = auto()
    WALL = auto()
    CLOTH = auto()
    ROOF = auto()
    CAR_BODY = auto()
    CAR_CABIN = auto()
    WHEEL = auto()
    METAL = auto()
    BARK = auto()
    LEAVES = auto()
    SIGNAL = auto()
    SIGN = auto()
    LAMP_HEAD = auto()


@dataclass(frozen=True, kw_only=True)
class Part:
    """One shape of the street.

    Parameters
    ----------
    shape, material
        What the ray meets, and what it looks like.
    colour
        Base reflectance, linear.
    origin, heading
        Frame of the texture: world position [m] and +1 or -1, the world x direction that is the part's forward.
    size
        Three numbers for the texture; each material says what they are.
    seed
        Tells alike parts apart.
    vehicle, street_light
        Instance that the part belongs to, 0 = none.
    """

    shape: Shape
    material: Material
    colour: Point = (0.5, 0.5, 0.5)
    origin: Point = (0.0, 0.0, 0.0)
    heading: int = 1
    size: Point = (1.0, 1.0, 1.0)
    seed: int = 0
    vehicle: int = 0
    street_light: int = 0
