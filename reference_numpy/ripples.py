"""Rings of raindrops on puddles. Paper, supplement "Surface Perturbation Effects".

Cells of the level plane; in each a drop lands at a hashed place once in a life, at a hashed time. A ring runs out from
it, one cell a life, and with d the distance from the ring's front, negative inside,

    height = I / k W sin(k d),   W = smoothstep(-b, -b / 2, d) smoothstep(0, -b / 2, d),
    I = I_drop (1 - (age / life)^2)^2

so that I is the slope of the waves; the nine cells around a place hold all rings that reach it. The normal n becomes
n - strength w M (slope of the heights' sum), M the puddle. Two conventions:

physical
    The cells lie in the world. I_drop is hashed, low to high; how likely a cell's drop falls follows from the rain.
    Where the pixel's footprint F outgrows the waves the slope fades, w = exp(-(k F)^2 / 8), and what it loses of its
    variance goes to the roughness, alpha^2 + 2 sigma^2 (1 - w^2) (Toksvig 2005).
paper
    Cells of 32 pixels, each for 1 m; every drop falls, I_drop rises and falls between low and high in 16 s, w = 1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from reference_numpy.noise import Hash, halves, hash2, scramble, unit
from reference_numpy.ramps import smoothstep
from reference_numpy.sampling import rays
from reference_numpy.world import Cells, cells_of, places

Array = NDArray[np.float64]

PIXELS = 32  # a cell, as printed
BEAT_BITS = 16  # of a tick: the printed intensity's period is 2^16 ticks
MOST_SLANT = 1e-3  # slope of the ray under which the footprint grows no more


def train(behind: Array, wave: float, steepness: float) -> tuple[Array, Array]:
    """Height times k, and slope, of a train of waves of intensity 1.

    Parameters
    ----------
    behind
        Distance behind the front, in cells; nothing moves before it.
    wave
        Wave number k in quarters of a turn a cell.
    steepness
        1 over half the length b of the train, in cells.
    """
    k = wave * np.pi / 2
    t = behind * steepness
    q = np.clip(np.minimum(t, 2 - t), 0.0, 1.0)
    window, rise = q * q * (3 - 2 * q), 6 * q * (1 - q) * steepness * np.where(t < 1, -1.0, 1.0)
    sine, cosine = -np.sin(k * behind), np.cos(k * behind)
    return window * sine, window * cosine + rise * sine / k


def drops(x: Cells, z: Cells, *, tick: int, life_bits: int, seed: int) -> tuple[Array, Array, Array, Array, Array]:
    """Each cell's latest drop: where it fell, 0 to 1 twice; its age, 0 to 1 of a life; two more numbers, 0 to 1."""
    cell: Hash = hash2(x, z, seed)
    mask = np.uint32((1 << life_bits) - 1)
    since = (cell & mask) + np.uint32(int(tick) & 0xFFFFFFFF)
    place = scramble(cell + (since >> np.uint32(life_bits)) * np.uint32(0x9E3779B1))
    u, w = halves(place)
    chance = scramble(place)
    age: Array = (since & mask).astype(np.float64) * 2.0**-life_bits
    return u, w, age, unit(chance), unit(scramble(chance))


def rings(
    x: Cells,
    z: Cells,
    u: Array,
    w: Array,
    *,
    tick: int,
    life_bits: int,
    sets: int,
    chance: float,
    low: float,
    high: float,
    wave: float,
    steepness: float,
    seed: int,
) -> tuple[Array, Array, Array]:
    """Sum of the rings at places (u, w) in cells (x, z): height times k, and slope along both axes.

    `sets` lattices, the first of seed `seed`, in each of which a drop falls with a probability of `chance`; `low`,
    `high` bound I_drop; `wave`, `steepness` as for `train`.
    """
    height, along_x, along_z = np.zeros(u.shape), np.zeros(u.shape), np.zeros(u.shape)
    for n in range(9 * sets):
        i, j = n % 3 - 1, n // 3 % 3 - 1
        pu, pw, age, luck, size = drops(x + i, z + j, tick=tick, life_bits=life_bits, seed=seed + n // 9)
        du, dw = u - (pu + i), w - (pw + j)
        r = np.sqrt(du**2 + dw**2)
        lift, slope = train(age - r, wave, steepness)
        strong = np.where(luck < chance, (low + (high - low) * size) * (1 - age**2) ** 2, 0.0)
        height += strong * lift
        along_x += strong * slope * du / np.maximum(r, 1e-18)
        along_z += strong * slope * dw / np.maximum(r, 1e-18)
    return height, along_x, along_z


def beat(tick: int, low: float, high: float) -> float:
    """The printed intensity at a time."""
    into = (int(tick) & ((1 << BEAT_BITS) - 1)) * 2.0**-BEAT_BITS
    return low + (high - low) * float(smoothstep(0.0, 1.0, np.abs(2 * np.asarray(into) - 1)))


def pixel_cells(shape: tuple[int, ...]) -> list[tuple[Cells, Array]]:
    """Numbers of the printed cells along the rows and down the columns, and how far into them pixels lie."""
    row, column = np.indices(shape)
    return [(i // PIXELS, i % PIXELS / PIXELS) for i in (column, row)]


def expected_slope_variance(
    *, chance: float, sets: int, low: float, high: float, wave: float, steepness: float
) -> float:
    """Variance of the slope along either axis over all places and times: that of one ring times the rings."""
    age, r, size = ((np.arange(n) + 0.5) / n for n in (200, 400, 200))
    _, slope = train(age[:, None] - r, wave, steepness)
    power = float((slope**2 * (1 - age[:, None] ** 2) ** 4 * 2 * np.pi * r).mean())
    return chance * sets * power * float(((low + (high - low) * size) ** 2).mean()) / 2


def footprint(shape: tuple[int, int], depth: Array, up: Array, *, fx: float, fy: float, cx: float, cy: float) -> Array:
    """Length of level ground [m] that a pixel sees, along the view."""
    ray, stretch = rays(shape, fx=fx, fy=fy, cx=cx, cy=cy)
    out: Array = depth / (fy * np.maximum(-stretch * (ray @ np.asarray(up)), MOST_SLANT))
    return out


def ripples(
    *,
    puddle: Array,
    normal: Array,
    roughness: Array,
    depth: Array,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    to_world: Array,
    to_world_lo: Array,
    eye: Array,
    eye_lo: Array,
    block: NDArray[np.int64],
    up: Array,
    tick: int,
    cells: int,
    sets: int,
    chance: float,
    low: float,
    high: float,
    wave: float,
    steepness: float,
    life_bits: int,
    strength: float,
    blur: float,
    variance: float,
    seed: int,
    convention: str,
) -> dict[str, Array]:
    """Let it rain on the puddles.

    Parameters
    ----------
    puddle, roughness, depth
        (H, W) how far under water, 0 to 1; 0 to 1; z of the surfaces [m].
    normal
        (H, W, 3) camera frame.
    fx, fy, cx, cy
        Intrinsics [px].
    to_world, to_world_lo, eye, eye_lo, block
        The camera's place: `reference_numpy.world.places`, `cells_of`.
    up
        (3,) the world's up, unit, camera frame.
    tick
        Time in ticks, modulo 2^32.
    cells
        Cells a block.
    sets, chance, low, high, wave, steepness, seed
        Of the rings: `rings`.
    life_bits
        A ring lives for 2^life_bits ticks.
    strength
        Of the slope, 0 to 1.
    blur
        k^2 / 8 [1/m^2].
    variance
        sigma^2, of the slope that the normals get.
    convention
        "physical" or "paper".

    Returns
    -------
    dict
        `normal` (H, W, 3), `roughness` (H, W); `ripple` (H, W), 1/2 + M k height / (2 high).
    """
    paper = convention == "paper"
    view = {"fx": fx, "fy": fy, "cx": cx, "cy": cy}
    R = np.asarray(to_world).reshape(3, 3)
    if paper:
        (x, u), (z, w) = pixel_cells(depth.shape)
        axis_x, axis_z = np.array([1.0, 0, 0]), np.array([0, 0, -1.0])  # right, and towards the eye
        least = most = beat(tick, low, high)
    else:
        at = places(depth, **view, to_world=to_world, to_world_lo=to_world_lo, eye=eye, eye_lo=eye_lo)
        (x, u), (z, w) = cells_of(at[..., 0], block[0], cells), cells_of(at[..., 2], block[2], cells)
        axis_x, axis_z, least, most = R[0], R[2], low, high
    height, along_x, along_z = rings(
        x, z, u, w, tick=tick, life_bits=life_bits, sets=sets, chance=chance, low=least, high=most, wave=wave,
        steepness=steepness, seed=seed,
    )  # fmt: skip
    fine = 0.0 if paper else blur * footprint(depth.shape, depth, up, **view) ** 2
    give = strength * puddle * np.exp(-fine)
    bend = give[..., None] * (along_x[..., None] * axis_x + along_z[..., None] * axis_z)
    moved = normal - bend
    was, now = (np.sqrt(np.einsum("...c,...c->...", n, n)) for n in (normal, moved))
    added = 2 * variance * puddle**2 * -np.expm1(-2 * fine)
    return {
        "normal": np.where(bend.any(axis=-1)[..., None], moved * (was / np.maximum(now, 1e-18))[..., None], normal),
        "roughness": np.where(added > 0, np.minimum((roughness**4 + added) ** 0.25, 1.0), roughness),
        "ripple": 0.5 + 0.5 * puddle * height / high,
    }
