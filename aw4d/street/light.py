"""Light on the street: the sun with its shadows, the sky, and what glossy things mirror."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aw4d.street import sky
from aw4d.street.cars import Car
from aw4d.street.surface import Surface

Array = NDArray[Any]

_SUN = sky.SUN.astype(np.float32)[:, None]
_SUN_COLOUR = sky.SUN_COLOUR[:, None]
_GLOSSY = 0.45  # roughness below which a surface mirrors


def along_sun(v: Array) -> Array:
    """Component of vectors towards the sun, (3, N) to (N,)."""
    return np.asarray(_SUN[0] * v[0] + _SUN[1] * v[1] + _SUN[2] * v[2])


def dot(a: Array, b: Array) -> Array:
    """Dot products, (3, N) and (3, N) to (N,)."""
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def radiance(s: Surface, normal: Array, view: Array, hidden: Array, leafy: Array) -> Array:
    """Light that surfaces send to the eye, (3, N).

    Parameters
    ----------
    s
        The surfaces; `openness` is the share of the sky that they see.
    normal, view
        Unit normals and directions of the rays in the world, (3, N).
    hidden
        No sunlight, (N,).
    leafy
        Leaves, which let light through, (N,).
    """
    NoL = np.where(hidden, np.float32(0), along_sun(normal))
    rgb = s.albedo * (1 - s.metallic) * (_SUN_COLOUR * NoL + sky.ambient(normal) * s.openness)
    rgb[:, leafy] += _through_leaves(s.albedo[:, leafy], normal[:, leafy], s.openness[leafy])
    glossy = np.flatnonzero(s.roughness < _GLOSSY)
    part = Surface(*(values[..., glossy] for values in s))
    rgb[:, glossy] += _gloss(part, normal[:, glossy], -view[:, glossy], NoL[glossy])
    return np.asarray(rgb + s.emissive, np.float32)


def _through_leaves(albedo: Array, normal: Array, openness: Array) -> Array:
    """Light that a crown scatters on: from the sky behind a leaf, and of the sun through and between the leaves."""
    behind = 0.35 * sky.ambient(-normal) + 0.22 * _SUN_COLOUR * (0.6 + 0.4 * along_sun(normal))
    return np.asarray(albedo * behind * openness)


def _gloss(s: Surface, n: Array, v: Array, NoL: Array) -> Array:
    """Mirrored surroundings and the sun's highlight (GGX, Walter et al. 2007; Fresnel after Schlick 1994)."""
    alpha2 = np.maximum(s.roughness, 0.09) ** 4
    NoV = np.clip(dot(n, v), 1e-3, 1)
    F0 = 0.04 + (s.albedo - 0.04) * s.metallic
    fresnel = F0 + (1 - F0) * (1 - NoV) ** 5
    mirror = sky.mirrored(2 * NoV * n - v) * s.openness
    half = v + _SUN
    NoH = np.clip(dot(n, half) / np.sqrt(dot(half, half)), 0, 1)
    # Visibility is taken as that of a smooth surface, 1 / (4 NoL NoV) times NoL NoV.
    lobe = alpha2 / (NoH**2 * (alpha2 - 1) + 1) ** 2 / 4
    return np.asarray(fresnel * mirror + F0 * lobe * NoL * _SUN_COLOUR)


def contact_shade(x: Array, z: Array, cars: Sequence[Car]) -> Array:
    """Share of the sky's light that the cars leave to the road beside and beneath them, (N,)."""
    share = np.ones(x.size, np.float32)
    order = np.argsort(x)
    sorted_x = x[order]
    for car in cars:
        length, _, width = car.size
        reach = length / 2 + 1.5
        near = order[slice(*np.searchsorted(sorted_x, (car.x - reach, car.x + reach)))]
        dx = np.maximum(np.abs(x[near] - car.x) - length / 2 + 0.15, 0)
        dz = np.maximum(np.abs(z[near] - car.z) - width / 2 + 0.2, 0)
        share[near] *= 1 - 0.85 * np.exp(-np.hypot(dx, dz) / 0.32)
    return share
