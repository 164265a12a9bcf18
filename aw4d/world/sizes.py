"""How large drops and flakes are, how many of each size there are, how fast they fall, how much light they stop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

DROP_MM = (0.5, 7.0)  # diameters of the drops that are counted: smaller ones are drizzle, larger ones break up
MELTED_MM = (0.3, 4.0)  # of the water in a flake
FINEST = 2_000  # steps of the tables of sizes


def drop_speed(diameter_mm: Array) -> Array:
    """Terminal speed of drops [m/s] in still air at sea level, 0.1 to 8 mm. Brandes, Zhang and Vivekanandan 2002."""
    D = diameter_mm
    return np.asarray(-0.1021 + D * (4.932 + D * (-0.9551 + D * (0.07934 - D * 0.002362))))


def flake_diameter(melted_mm: Array) -> Array:
    """Diameter [mm] of a flake whose water makes a drop of that diameter.

    A flake of d mm has 0.17 / d of water's density (Holroyd 1971), so that d^2 = D^3 / 0.17.
    """
    return np.sqrt(np.asarray(melted_mm) ** 3 / 0.17)


def flake_speed(diameter_mm: Array) -> Array:
    """Speed [m/s] of aggregates of dendrites of some diameter. Locatelli and Hobbs 1974."""
    return 0.8 * np.asarray(diameter_mm) ** 0.16


@dataclass(frozen=True, kw_only=True, eq=False)
class Sizes:
    """What falls, by size.

    Parameters
    ----------
    diameter_mm
        (N,) increasing, of what is seen.
    speed
        (N,) [m/s] downwards.
    number
        (N,) per cubic metre and step of the table.
    """

    diameter_mm: Array
    speed: Array
    number: Array

    def extinction(self) -> float:
        """Share of light that is stopped [1/m]: twice the cross section (geometric optics with diffraction)."""
        area = np.pi / 4 * (self.diameter_mm * 1e-3) ** 2
        return float(2 * (area * self.number).sum())


def _exponential(
    rate_mm_h: float, slope: float, limits: tuple[float, float], diameter: Callable[[Array], Array], speed: Array
) -> Sizes:
    """N0 exp(-slope D) of drops or of melted flakes, N0 such that the water that falls adds up to the rate."""
    D = _steps(limits)
    shape = np.exp(-slope * D)
    litres = np.pi / 6 * (D * 1e-3) ** 3 * 1e3  # of one, per square metre the same as mm
    return Sizes(
        diameter_mm=diameter(D),
        speed=speed,
        number=shape * (rate_mm_h / 3600 / float((shape * litres * speed).sum())),
    )


def _steps(limits: tuple[float, float]) -> Array:
    """Middles of equal steps between limits."""
    low, high = limits
    return np.asarray(low + (np.arange(FINEST) + 0.5) * ((high - low) / FINEST), dtype=np.float64)


@cache
def rain_sizes(rate_mm_h: float) -> Sizes:
    """Drops of a rain: the slope of Marshall and Palmer 1948, 4.1 R^-0.21 /mm; their number adds up to the rate.

    Parameters
    ----------
    rate_mm_h
        Rain rate R [mm/h], >= 0.
    """
    slope = 4.1 * max(rate_mm_h, 0.01) ** -0.21
    return _exponential(rate_mm_h, slope, DROP_MM, lambda D: D, drop_speed(_steps(DROP_MM)))


@cache
def snow_sizes(rate_mm_h: float) -> Sizes:
    """Flakes of a snowfall: the slope of Gunn and Marshall 1958, 2.55 R^-0.48 /mm of melted diameter.

    Parameters
    ----------
    rate_mm_h
        Water that falls R [mm/h], >= 0; their number adds up to it.
    """
    slope = 2.55 * max(rate_mm_h, 0.01) ** -0.48
    speed = flake_speed(flake_diameter(_steps(MELTED_MM)))
    return _exponential(rate_mm_h, slope, MELTED_MM, flake_diameter, speed)


def rain_extinction(rate_mm_h: float) -> float:
    """Extinction coefficient [1/m] of a rain's drops."""
    return rain_sizes(rate_mm_h).extinction()


def snow_extinction(rate_mm_h: float) -> float:
    """Extinction coefficient [1/m] of a snowfall's flakes."""
    return snow_sizes(rate_mm_h).extinction()
