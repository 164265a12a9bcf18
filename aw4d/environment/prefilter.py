"""Tables of an environment: irradiance and prefiltered specular light for every direction, and the table of lobes."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from aw4d.environment.latlong import sample, shrink, solid_angles
from reference_numpy.brdf import V_SmithGGXCorrelated, alpha_of
from reference_numpy.environment import octahedral_grid

Array = NDArray[np.float64]

ROWS, COLUMNS = 128, 256  # of the map that is summed over
LEVELS = 8  # of roughness: 0, 1/7, ..., 1
SIZE = 65  # texels of a table's side: odd, so that the directions of the axes lie on texels
SPLIT = 32  # side of the table of lobes
NODES = 96  # of its quadrature, squared


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


def _to_octahedral(radiance: Array, size: int) -> Array:
    """A smooth map, (R, C, 3), as an octahedral table, by cubic interpolation; never below 0."""
    d = octahedral_grid(size)
    around, over = 8, 4
    turned = np.roll(radiance, COLUMNS // 2, axis=1)  # what lies over the pole is half a turn away
    padded = np.concatenate([turned[over - 1 :: -1], radiance, turned[: -over - 1 : -1]])
    padded = np.pad(padded, ((0, 0), (around, around), (0, 0)), mode="wrap")
    row = np.arccos(np.clip(d[..., 1], -1, 1)) / np.pi * ROWS - 0.5 + over
    column = (np.arctan2(d[..., 0], -d[..., 2]) / (2 * np.pi) + 0.5) * COLUMNS - 0.5 + around
    planes = [map_coordinates(padded[..., i], [row, column], order=3, mode="nearest") for i in range(3)]
    return np.maximum(np.stack(planes, axis=-1), 0.0)


def irradiance_table(radiance: Array, size: int = SIZE) -> Array:
    """Irradiance of surfaces that face every direction, (N, N, 3), of a lat-long map of radiance, (H, W, 3)."""
    cosine = np.maximum(_angles_between(), 0.0)
    return _to_octahedral(_convolve(shrink(radiance, ROWS, COLUMNS), cosine, mean=False), size)


def specular_table(radiance: Array, size: int = SIZE) -> Array:
    """Mean radiance that a surface of every roughness sees around every direction, (LEVELS, N, N, 3).

    The lobe is that of light reflected towards the normal, where eye, normal and mirror direction are the same (Karis
    2013); the weight of light at an angle a to it is D(a / 2) times `_shadowing`.
    """
    small = shrink(radiance, ROWS, COLUMNS)
    cosine = _angles_between()
    NoH2 = (1 + cosine) / 2
    levels = [np.maximum(sample(radiance if len(radiance) < ROWS else small, octahedral_grid(size)), 0.0)]
    for level in range(1, LEVELS):
        a2 = (level / (LEVELS - 1)) ** 4
        lobe = _shadowing(np.maximum(cosine, 0.0), a2) / (1 - NoH2 + NoH2 * a2) ** 2
        levels.append(_to_octahedral(_convolve(small, lobe, mean=True), size))
    return np.stack(levels)


def _shadowing(NoL: Array, a2: float | Array) -> Array:
    """4 V NoL of the height-correlated visibility V at NoV = 1, Heitz 2014; a2 is alpha squared."""
    return 2 * NoL / (NoL + np.sqrt(NoL**2 * (1 - a2) + a2))


def _lobe_lengths() -> tuple[Array, Array]:
    """Roughness, and the length of the mean direction of its lobe in `specular_table`, which falls with it."""
    roughness = np.linspace(0, 1, 101)
    x, w = np.polynomial.legendre.leggauss(200)
    a2 = np.maximum(roughness, 1e-3)[:, None] ** 4
    # tan^2 of half the angle as a2 s / (1 - s): D sin(a) da is flat in s, so that lobes of every width resolve alike
    tan2 = a2 * ((x + 1) / 2 / (1 - (x + 1) / 2))
    cosine = np.maximum((1 - tan2) / (1 + tan2), 0.0)
    weight = w * _shadowing(cosine, a2)
    return roughness, (weight * cosine).sum(axis=1) / weight.sum(axis=1)


@cache
def lobe_table(size: int = SPLIT) -> Array:
    """Shares and lobes of the two parts of the Fresnel term, (M, M, 8); see `reference_numpy.environment.lobes`.

    int V 4 VoH / NoH NoL F over half vectors drawn by D NoH (Karis 2013), with Gauss-Legendre nodes in place of random
    draws; F is 1 - (1 - VoH)^5 and (1 - VoH)^5. A lobe is told by its mean vector: the direction, and the length, which
    says how wide it is.
    """
    NoV = np.clip(np.linspace(0, 1, size) ** 2, 1e-4, 1 - 1e-6)
    x, w = np.polynomial.legendre.leggauss(NODES)
    share, turn = ((x + 1) / 2)[:, None], (x + 1) / 2 * np.pi
    weight = np.outer(w, w) / 4
    widths, lengths = _lobe_lengths()
    out = np.zeros((size, size, 8))
    for i, alpha in enumerate(alpha_of(np.linspace(0, 1, size))):
        NoH = np.sqrt((1 - share) / (1 + (alpha**2 - 1) * share))
        h_x = np.sqrt(1 - NoH**2) * np.cos(turn)
        for j, cosine in enumerate(NoV):
            sine = np.sqrt(1 - cosine**2)
            VoH = np.clip(sine * h_x + cosine * NoH, 0.0, 1.0)
            NoL = np.maximum(2 * VoH * NoH - cosine, 0.0)
            V = V_SmithGGXCorrelated(cosine, np.maximum(NoL, 1e-9), alpha)
            reflected = weight * V * 4 * VoH / NoH * NoL
            forward = 2 * VoH * h_x - sine  # component of the light's direction away from the eye, negative
            for part, F in enumerate((1 - (1 - VoH) ** 5, (1 - VoH) ** 5)):
                total = (F * reflected).sum()
                mean_n, mean_t = (F * reflected * NoL).sum() / total, -(F * reflected * forward).sum() / total
                tan = mean_t / mean_n
                away = sine - tan * cosine
                rough = np.interp(-np.hypot(mean_n, mean_t), -lengths, widths)
                # A lobe that is all but dark at the mirror direction may point anywhere; it carries next to nothing.
                out[i, j, 4 * part : 4 * part + 3] = total, np.clip(away / (away + tan), -0.5, 1.5), rough
    return out
