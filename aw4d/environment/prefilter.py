"""Tables of an environment: irradiance and prefiltered specular light by direction, and the table of lobes."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from aw4d.environment.latlong import sample, shrink, solid_angles
from reference_numpy.brdf import V_SmithGGXCorrelated, alpha_of
from reference_numpy.environment import LOBES, PARTS, octahedral_grid
from reference_numpy.srgb import LUMINANCE

Array = NDArray[np.float64]

ROWS, COLUMNS = 128, 256  # of the map that is summed over
LEVELS = 8  # of roughness: 0, 1/7, ..., 1
SIZE = 129  # texels of a table's side: odd, so that the directions of the axes lie on texels
ELEVATIONS = 256  # cells of a zonal table between straight down and straight up
SPLIT = 32  # side of the table of lobes
NODES = 64  # of its quadrature, squared
SAME = 1e-6  # of the brightest, by which a zonal map may differ from one
STRIPS = (0.0, 0.3, 0.75, 1.0)  # of the lobe of the part with F0: shares of its light up to their ends


def _angles_between() -> Array:
    """Cosine between directions of the target's upper rows, the source's rows, and half a turn: (R/2, R, C/2 + 1)."""
    altitude = np.pi / 2 - (np.arange(ROWS) + 0.5) * (np.pi / ROWS)
    turn = np.arange(COLUMNS // 2 + 1) * (2 * np.pi / COLUMNS)
    sine, cosine = np.sin(altitude), np.cos(altitude)
    level = np.outer(cosine[: ROWS // 2], cosine)
    return np.outer(sine[: ROWS // 2], sine)[..., None] + level[..., None] * np.cos(turn)


def _convolve(radiance: Array, kernel: Array, *, mean: bool) -> Array:
    """Sum over the sphere of a map times a kernel of the angle; both sides of the product on the same grid.

    Along the columns it is a convolution, a product of their Fourier transforms: exact, and as fast as one matrix
    product a frequency. With `mean` the kernel's own sum, at each target, is divided out.
    """
    weight = kernel * solid_angles(ROWS, COLUMNS)[None]
    if mean:
        doubled = np.full(weight.shape[-1], 2.0)
        doubled[[0, -1]] = 1.0
        weight = weight / (weight @ doubled).sum(axis=1)[:, None, None]
    upper = np.fft.rfft(np.concatenate([weight, weight[..., -2:0:-1]], axis=-1), axis=-1).real
    spectrum = np.fft.rfft(radiance, axis=1)
    above = np.einsum("tsm,smc->tmc", upper, spectrum, optimize=True)
    below = np.einsum("tsm,smc->tmc", upper, spectrum[::-1], optimize=True)[::-1]
    return np.fft.irfft(np.concatenate([above, below]), COLUMNS, axis=1)


def _smooth(radiance: Array, d: Array) -> Array:
    """A smooth map, (R, C, 3), in unit directions (..., 3), by cubic interpolation, (..., 3); never below 0."""
    from scipy.ndimage import map_coordinates  # here: tables that are kept on disk need none of SciPy

    around, over = 8, 4
    turned = np.roll(radiance, COLUMNS // 2, axis=1)  # what lies over the pole is half a turn away
    padded = np.concatenate([turned[over - 1 :: -1], radiance, turned[: -over - 1 : -1]])
    padded = np.pad(padded, ((0, 0), (around, around), (0, 0)), mode="wrap")
    row = np.arccos(np.clip(d[..., 1], -1, 1)) / np.pi * ROWS - 0.5 + over
    column = (np.arctan2(d[..., 0], -d[..., 2]) / (2 * np.pi) + 0.5) * COLUMNS - 0.5 + around
    planes = [map_coordinates(padded[..., i], [row, column], order=3, mode="nearest") for i in range(3)]
    return np.maximum(np.stack(planes, axis=-1), 0.0)


def irradiance(radiance: Array, d: Array) -> Array:
    """Irradiance of surfaces that face unit directions (..., 3), to (..., 3), by a lat-long map, (H, W, 3)."""
    cosine = np.maximum(_angles_between(), 0.0)
    return _smooth(_convolve(shrink(radiance, ROWS, COLUMNS), cosine, mean=False), d)


def specular(radiance: Array, d: Array) -> Array:
    """Mean radiance that a surface of every roughness sees around unit directions (..., 3), (LEVELS, ..., 3).

    The lobe is that of light reflected towards the normal, where eye, normal and mirror direction are the same (Karis
    2013); the weight of light at an angle a to it is D(a / 2) times `_shadowing`.
    """
    small = shrink(radiance, ROWS, COLUMNS)
    cosine = _angles_between()
    NoH2 = (1 + cosine) / 2
    levels = [np.maximum(sample(radiance if len(radiance) < ROWS else small, d), 0.0)]
    for level in range(1, LEVELS):
        a2 = (level / (LEVELS - 1)) ** 4
        lobe = _shadowing(np.maximum(cosine, 0.0), a2) / (1 - NoH2 + NoH2 * a2) ** 2
        levels.append(_smooth(_convolve(small, lobe, mean=True), d))
    return np.stack(levels)


def is_zonal(radiance: Array) -> bool:
    """Whether a map, (H, W, 3), has one colour and is alike all around."""
    column = radiance[:, 0]
    alike = np.outer(column @ LUMINANCE, _colour(radiance))
    return bool(np.abs(radiance - alike[:, None]).max() <= SAME * column.max())


def _colour(radiance: Array) -> Array:
    """Mean colour of a map, of luminance 1; white where it is black."""
    mean = radiance.mean(axis=(0, 1))
    luminance = float(mean @ LUMINANCE)
    return mean / luminance if luminance > 0 else np.ones(3)


def tables(radiance: Array) -> dict[str, Array]:
    """A lat-long map, (H, W, 3), by the names of the tables that passes look it up in, texels of three numbers.

    Octahedral ones, (SIZE, SIZE, 3) and (LEVELS, SIZE, SIZE, 3), and what goes by elevation alone, (LEVELS, E, 4) and
    (3,): E is 0 for a map that is not zonal.
    """
    y = np.linspace(-1, 1, ELEVATIONS + 1) if is_zonal(radiance) else np.zeros(1)
    upright = np.stack([np.sqrt(1 - y**2), y, np.zeros(y.shape)], axis=-1)
    d = np.concatenate([octahedral_grid(SIZE).reshape(-1, 3), upright])  # together: the sums over the sphere take long
    light, levels = irradiance(radiance, d), specular(radiance, d)
    texels = SIZE * SIZE
    return {
        "env_irradiance": light[:texels].reshape(SIZE, SIZE, 3),
        "env_specular": levels[:, :texels].reshape(-1, SIZE, SIZE, 3),
        "env_zonal": _cells(np.concatenate([levels[:, texels:], light[None, texels:] / np.pi]) @ LUMINANCE),
        "env_colour": _colour(radiance),
    }


def _cells(rows: Array) -> Array:
    """Levels by elevation and below them the irradiance over pi, (LEVELS + 1, E + 1), as `env_zonal`.

    See `reference_numpy.environment.zonal`. There are as many rows of cells as levels, the last one the irradiance's.
    """
    levels, light = rows[:-1], rows[-1:]
    upper, lower = np.concatenate([levels[:-1], light]), np.concatenate([levels[1:], light])
    return np.stack([upper[:, :-1], upper[:, 1:], lower[:, :-1], lower[:, 1:]], axis=-1)


def _shadowing(NoL: Array, a2: float | Array) -> Array:
    """4 V NoL of the height-correlated visibility V at NoV = 1, Heitz 2014; a2 is alpha squared."""
    return 2 * NoL / (NoL + np.sqrt(NoL**2 * (1 - a2) + a2))


def _level_moments() -> tuple[Array, Array]:
    """Of the lobe of every level of `specular`: length of the mean direction, and mean square of one of the
    components across it."""
    roughness = np.linspace(0, 1, LEVELS)
    x, w = np.polynomial.legendre.leggauss(200)
    a2 = np.maximum(roughness, 1e-3)[:, None] ** 4
    # tan^2 of half the angle as a2 s / (1 - s): D sin(a) da is flat in s, so that lobes of every width resolve alike
    tan2 = a2 * ((x + 1) / 2 / (1 - (x + 1) / 2))
    cosine = np.maximum((1 - tan2) / (1 + tan2), 0.0)
    weight = w * _shadowing(cosine, a2)
    weight /= weight.sum(axis=1, keepdims=True)
    return (weight * cosine).sum(axis=1), (weight * (1 - cosine**2)).sum(axis=1) / 2


@cache
def lobe_table(size: int = SPLIT) -> Array:
    """Lobes of the two parts of the Fresnel term, (M, M, LOBES, 4); see `reference_numpy.environment.lobes`.

    A part's lobe is cut across the plane of incidence into strips, each of which is a round lobe: see `_round_lobes`.
    """
    NoV = np.clip(np.linspace(0, 1, size) ** 2, 1e-4, 1 - 1e-6)
    light, mean, across = (np.zeros((size, size, LOBES, *more)) for more in ((), (2,), ()))
    for i, alpha in enumerate(alpha_of(np.linspace(0, 1, size))):
        for j, cosine in enumerate(NoV):
            to_light, parts = _reflection(float(cosine), float(alpha))
            for part, strips in zip(parts, PARTS, strict=True):
                ends = STRIPS if strips.stop - strips.start > 1 else (0.0, 1.0)
                light[i, j, strips], mean[i, j, strips], across[i, j, strips] = _strips(to_light, part, ends)
    out = np.zeros((size, size, LOBES, 4))
    mirror = np.arccos(NoV)[:, None]
    for strips in PARTS:
        angle, roughness = _round_lobes(light[:, :, strips], mean[:, :, strips], across[:, :, strips])
        # Lobes beyond these bounds carry next to nothing. Where the eye looks along the normal, turns have no meaning.
        turn = np.clip(np.sin(mirror - angle) / (np.sin(angle) + np.sin(mirror - angle)), -1.0, 3.0)
        turn[:, -1] = turn[:, -2]
        out[:, :, strips, :3] = np.stack([light[:, :, strips], turn, roughness], axis=-1)
    return out


def _reflection(NoV: float, alpha: float) -> tuple[Array, tuple[Array, Array]]:
    """Directions to the light, (S, 3): away from the eye, along the normal, across; and the light of the two parts.

    int V 4 VoH / NoH NoL F over half vectors drawn by D NoH (Karis 2013), with Gauss-Legendre nodes in place of random
    draws, on one side of the plane of incidence; F is 1 - (1 - VoH)^5 and (1 - VoH)^5.
    """
    x, w = np.polynomial.legendre.leggauss(NODES)
    share, turn = ((x + 1) / 2)[:, None], (x + 1) / 2 * np.pi
    sine = np.sqrt(1 - NoV**2)
    NoH = np.sqrt((1 - share) / (1 + (alpha**2 - 1) * share))
    h_x, h_y = np.sqrt(1 - NoH**2) * np.cos(turn), np.sqrt(1 - NoH**2) * np.sin(turn)
    VoH = np.clip(NoV * NoH - sine * h_x, 0.0, 1.0)
    to_light = np.stack([2 * VoH * h_x + sine, 2 * VoH * NoH - NoV, 2 * VoH * h_y], axis=-1).reshape(-1, 3)
    NoL = np.maximum(2 * VoH * NoH - NoV, 0.0)
    V = V_SmithGGXCorrelated(NoV, np.maximum(NoL, 1e-9), alpha)
    reflected = np.outer(w, w) / 4 * V * 4 * VoH / NoH * NoL
    schlick = (1 - VoH) ** 5
    return to_light, ((reflected * (1 - schlick)).ravel(), (reflected * schlick).ravel())


def _strips(to_light: Array, light: Array, ends: tuple[float, ...]) -> tuple[Array, Array, Array]:
    """Light of the strips of a lobe, by shares of it from the eye's side on, (K,); mean vectors in the plane of
    incidence, (K, 2), and mean squares across it, (K,)."""
    order = np.argsort(np.arctan2(to_light[:, 0], to_light[:, 1]))
    to_light, light = to_light[order], light[order]
    last = np.cumsum(light)
    first, edges = last - light, np.array(ends)[:, None] * last[-1]
    inside = np.maximum(np.minimum(last, edges[1:]) - np.maximum(first, edges[:-1]), 0.0)
    total = inside.sum(axis=1)
    return total, inside @ to_light[:, :2] / total[:, None], inside @ to_light[:, 2] ** 2 / total


def _round_lobes(light: Array, mean: Array, across: Array) -> tuple[Array, Array]:
    """Angles from the normal, away from the eye, and roughness of round lobes (..., K) that stand for strips.

    Each is as wide as its strip is across the plane of incidence. Their angles are those of the strips, spread or drawn
    together and turned such that the mean vector of them all is the whole lobe's: a round lobe's strips draw together.
    """
    length, square = _level_moments()
    share = light / light.sum(axis=-1, keepdims=True)
    whole = np.einsum("...k,...kc->...c", share, mean)
    middle, goal = np.arctan2(whole[..., :1], whole[..., 1:]), np.linalg.norm(whole, axis=-1, keepdims=True)
    rough = np.interp(across, square, np.linspace(0, 1, LEVELS)) if light.shape[-1] > 1 else np.ones_like(across)
    long = np.interp(rough, np.linspace(0, 1, LEVELS), length)
    long = np.minimum(long * np.maximum(goal / (share * long).sum(axis=-1, keepdims=True), 1.0), 1.0)
    apart = np.arctan2(mean[..., 0], mean[..., 1]) - middle

    def sum_of(spread: Array) -> tuple[Array, Array]:
        x, y = (share * long * f(spread * apart) for f in (np.sin, np.cos))
        return x.sum(axis=-1, keepdims=True), y.sum(axis=-1, keepdims=True)

    low, high = np.zeros_like(goal), np.full_like(goal, 1.5)
    for _ in range(30):
        half = (low + high) / 2
        longer = np.hypot(*sum_of(half)) > goal
        low, high = np.where(longer, half, low), np.where(longer, high, half)
    angle = middle + low * apart - np.arctan2(*sum_of(low))
    return angle, np.interp(-long, -length, np.linspace(0, 1, LEVELS))
