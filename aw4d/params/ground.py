"""Parameters of water on the ground: wet surfaces, puddles, ripples."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from aw4d.errors import InputError
from aw4d.params.base import Params, param
from reference_numpy.noise import value_noise
from reference_numpy.ramps import smoothstep
from reference_numpy.ripples import expected_slope_variance
from reference_numpy.world import BLOCK

SAMPLES = 2**15  # of the noise, to know its distribution: a share of 0.2 to 0.002
TICKS_BITS = 12  # a second is 2^12 ticks
BIG_DROP_MM = 3.0  # smaller ones make no ring as long as these waves


def _single(value: float) -> float:
    """As a float32 holds it: what is rounded here is the same number on every backend."""
    return float(np.float32(value))


def _cells(size_m: float, name: str, finest: int = 1) -> int:
    """Cells a block."""
    cells = round(BLOCK / size_m)
    if not math.isclose(cells * size_m, BLOCK, rel_tol=1e-6):
        raise InputError(f"{name}: expected {BLOCK:g} m over a whole number, got {size_m:g} m")
    if cells * finest > 2**14:
        raise InputError(f"{name}: expected at most {2**14} cells in {BLOCK:g} m, got {cells * finest}")
    return cells


@dataclass(frozen=True, kw_only=True)
class WetGroundParams(Params):
    """Wet surfaces. Paper, supplement "Wet ground implementation"."""

    wetness: float = param(0.5, "1", "the wetness of what lies open to the sky", "paper", low=0, high=1, host=True)
    porosity: float = param(0.8, "1", "the porosity of the most porous surfaces", "paper", low=0, high=1)
    water_albedo: float = param(0.02, "1", "the albedo of water", "paper", low=0, high=1)
    water_roughness: float = param(0.1, "1", "the roughness of what is all wet", "paper", low=0, high=1)
    film: float = param(0.4, "1", "the share of the smoothing that surfaces off the road get", "", low=0, high=1)
    optical_depth: float = param(0.0, "1", "the optical depth of the water on it", "paper", low=0, high=1e3)
    convention: Literal["physical", "paper"] = param("physical", "", "the formulas: physical or paper", "docs/paper.md")

    def arguments(self) -> dict[str, Any]:
        """Fields by name; the plane is called `wetness` too, so the field goes by the paper's name for it."""
        return super().arguments() | {"intensity": self.wetness}


@lru_cache(maxsize=8)
def _drawn(weight: tuple[float, ...], cells: int) -> tuple[NDArray[np.float64], float]:
    """The noise at places all over the world, and the root mean square of its slope [1/m]."""
    rng = np.random.default_rng(1)
    x, z = rng.integers(-(2**31), 2**31, (2, SAMPLES))
    u, w = rng.random((2, SAMPLES))
    noise, slope2, step = np.zeros(SAMPLES), 0.0, 1e-4
    for o, share in enumerate(weight):
        octave = value_noise(x, z, u, w, o)
        noise += share * octave
        rise = (value_noise(x, z, u + step, w, o) - octave) / step * share * (cells << o) / BLOCK
        slope2 += 2 * float((rise**2).mean())
        (x, u), (z, w) = ((2 * i + (2 * f >= 1), 2 * f % 1) for i, f in ((x, u), (z, w)))
    return noise, math.sqrt(slope2)


@lru_cache(maxsize=64)
def _level(share: float, steepness: float, weight: tuple[float, ...], cells: int) -> float:
    """The level over which the given share of the noise lies, shores counted by how far they are under water."""
    if share in (0.0, 1.0):
        return 2.0 - 3.0 * share
    noise, _ = _drawn(weight, cells)
    low, high = -1.0, 2.0
    for _ in range(40):
        middle = (low + high) / 2
        under = smoothstep(0.0, 1.0, (noise - middle) * steepness + 0.5).mean()
        low, high = (middle, high) if under > share else (low, middle)
    return (low + high) / 2


@dataclass(frozen=True, kw_only=True)
class PuddlesParams(Params):
    """Puddles on the road. Paper, supplement "Geometry-Anchored Puddle Modeling"."""

    share: float = param(0.2, "1", "the share of the road that is under water", "", low=0, high=1, host=True)
    size_m: float | None = param(
        None, "m", "the cell of the first octave (physical: 10, paper: 20)", "paper", low=0.1, high=160, host=True
    )
    octaves: int | None = param(None, "1", "the octaves (physical: 4, paper: 3)", "paper", low=1, high=8)
    persistence: float | None = param(
        None, "1", "the weight of an octave over that of the one before (physical: 0.7, paper: 0.5)", "paper",
        low=0.05, high=2, host=True,
    )  # fmt: skip
    shore_m: float = param(0.3, "m", "the width of the shores", "", low=0.01, high=10, host=True)
    level_deg: float = param(8.0, "deg", "the slope up to which water stands", "", low=0.1, high=45, host=True)
    optical_depth: float = param(0.7, "1", "the optical depth of the water, down and up", "", low=0, high=1e3)
    seed: int = param(11, "1", "the seed of the noise", "", low=0, high=2**30)
    convention: Literal["physical", "paper"] = param("physical", "", "the formulas: physical or paper", "docs/paper.md")

    def __post_init__(self) -> None:
        super().__post_init__()
        size_m, octaves, persistence = (20.0, 3, 0.5) if self.convention == "paper" else (10.0, 4, 0.7)
        for name, value in (("size_m", size_m), ("octaves", octaves), ("persistence", persistence)):
            if getattr(self, name) is None:
                object.__setattr__(self, name, value)
        self._lattice()

    def _lattice(self) -> tuple[int, tuple[float, ...]]:
        """Cells a block, and the octaves' weights: 1/2, 1/4, .. as printed, else of sum 1."""
        assert self.size_m is not None  # these three are set by __post_init__
        assert self.octaves is not None
        assert self.persistence is not None
        weight = [self.persistence ** (o + 1) for o in range(self.octaves)]
        whole = 1.0 if self.convention == "paper" else sum(weight)
        cells = _cells(self.size_m, "size_m", finest=2 ** (self.octaves - 1))
        return cells, tuple(_single(w / whole) for w in weight)

    def arguments(self) -> dict[str, Any]:
        """Fields by name; the share as a level of the noise, widths as its steepness, the angle as its squared sine."""
        cells, weight = self._lattice()
        _, slope = _drawn(weight, cells)
        steepness = _single(1 / (slope * self.shore_m))
        flat, steep = (_single(math.sin(math.radians(a)) ** 2) for a in (self.level_deg, 2 * self.level_deg))
        return super().arguments() | {
            "cells": cells,
            "weight": np.array(weight, dtype=np.float32),
            "level": _single(_level(self.share, steepness, weight, cells)),
            "steepness": steepness,
            "flat": flat,
            "steep": steep,
        }


@lru_cache(maxsize=64)
def _variance(**rain: Any) -> float:
    return expected_slope_variance(**rain)


def big_drops(rate_mm_h: float) -> float:
    """Drops of more than BIG_DROP_MM that fall on a level surface [1/(m^2 s)].

    Sizes: 8000 exp(-4.1 R^-0.21 D) per m^3 and mm (Marshall and Palmer 1948); fall: 9.65 - 10.3 exp(-0.6 D) m/s
    (Atlas et al. 1973).
    """
    if rate_mm_h <= 0:
        return 0.0
    slope = 4.1 * rate_mm_h**-0.21
    still = 9.65 / slope * math.exp(-slope * BIG_DROP_MM)
    return 8000 * (still - 10.3 / (slope + 0.6) * math.exp(-(slope + 0.6) * BIG_DROP_MM))


@dataclass(frozen=True, kw_only=True)
class RipplesParams(Params):
    """Rings of raindrops on puddles. Paper, supplement "Surface Perturbation Effects"."""

    rate_mm_h: float = param(
        6.0, "mm/h", "the water that falls", "Marshall and Palmer 1948", low=0, high=300, host=True
    )
    cell_m: float = param(0.5, "m", "the cell, and how far a ring runs", "", low=0.02, high=10, host=True)
    sets: int | None = param(None, "1", "the lattices of cells (physical: 3, paper: 1)", "", low=1, high=8)
    life_s: float = param(1.0, "s", "the life of a ring, a power of two", "", low=2**-6, high=64, host=True)
    wave_rad_m: float = param(31.0, "rad/m", "the wave number", "paper", low=0.1, high=1e4, host=True)
    train_m: float = param(0.6, "m", "the length of a ring's train of waves", "paper", low=0.01, high=10, host=True)
    low: float = param(0.01, "1", "the slope of the smallest drops' waves", "paper", low=0, high=1)
    high: float = param(0.15, "1", "the slope of the largest drops' waves", "paper", low=1e-3, high=1)
    strength: float = param(0.9, "1", "the strength of the slopes in the normals", "paper", low=0, high=1)
    seed: int = param(23, "1", "the seed of the drops", "", low=0, high=2**30)
    convention: Literal["physical", "paper"] = param("physical", "", "the formulas: physical or paper", "docs/paper.md")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.sets is None:
            object.__setattr__(self, "sets", 1 if self.convention == "paper" else 3)
        if not math.log2(self.life_s).is_integer():
            raise InputError(f"life_s: expected a power of two, got {self.life_s:g} s")
        if self.low > self.high:
            raise InputError(f"low: expected at most high = {self.high:g}, got {self.low:g}")
        _cells(self.cell_m, "cell_m")

    def arguments(self) -> dict[str, Any]:
        """Fields by name; lengths in cells, the rain as a probability; a printed cell counts for a metre."""
        assert self.sets is not None  # set by __post_init__
        paper = self.convention == "paper"
        cell_m = 1.0 if paper else self.cell_m
        slots = self.sets / (cell_m**2 * self.life_s)
        train = {
            "chance": 1.0 if paper else _single(min(1.0, big_drops(self.rate_mm_h) / slots)),
            "wave": _single(self.wave_rad_m * cell_m / (math.pi / 2)),
            "steepness": _single(2 * cell_m / self.train_m),
        }
        variance = _variance(sets=self.sets, low=self.low, high=self.high, **train)
        return (
            super().arguments()
            | train
            | {
                "cells": _cells(self.cell_m, "cell_m"),
                "life_bits": TICKS_BITS + round(math.log2(self.life_s)),
                "blur": self.wave_rad_m**2 / 8,
                "variance": self.strength**2 * variance,
            }
        )
