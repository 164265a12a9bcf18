"""Cook-Torrance reflection: GGX, height-correlated Smith, Schlick. Paper, supplement "BRDF Modeling"."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

MIN_ROUGHNESS = 0.045  # alpha = 0 has no finite lobe; Lagarde and de Rousiers 2014
MIN_NOV = 1e-4  # at grazing view and beyond
DIELECTRIC_F0 = 0.04  # Fresnel reflectance at normal incidence of index 1.5


def alpha_of(roughness: ArrayLike) -> Array:
    """alpha = r^2 of the perceptual roughness, clamped to a lobe that has a width."""
    return np.maximum(np.asarray(roughness, dtype=np.float64), MIN_ROUGHNESS) ** 2


def D_GGX(n: Array, h: Array, alpha: ArrayLike) -> Array:
    """Distribution of microfacet normals [1/sr], (...,) of unit vectors (..., 3).

    Walter et al. 2007; 1 - NoH^2 as |n x h|^2 (Lagrange's identity), which keeps its digits where h meets n.
    """
    a2 = np.asarray(alpha) ** 2
    across = np.cross(n, h)
    NoH = _dot(n, h)
    return a2 / (np.pi * (_dot(across, across) + NoH**2 * a2) ** 2)


def V_SmithGGXCorrelated(NoV: ArrayLike, NoL: ArrayLike, alpha: ArrayLike) -> Array:
    """Visibility G / (4 NoV NoL), height-correlated. Heitz 2014; the paper prints it as G."""
    NoV, NoL, a2 = np.asarray(NoV), np.asarray(NoL), np.asarray(alpha) ** 2
    return 0.5 / (NoL * np.sqrt(NoV**2 * (1 - a2) + a2) + NoV * np.sqrt(NoL**2 * (1 - a2) + a2))


def F_Schlick(f0: ArrayLike, LoH: ArrayLike) -> Array:
    """Fresnel reflectance f0 + (1 - f0) (1 - LoH)^5. Schlick 1994."""
    f0 = np.asarray(f0, dtype=np.float64)
    return f0 + (1 - f0) * (1 - np.asarray(LoH)) ** 5


def interface_share(NoV: ArrayLike, roughness: ArrayLike) -> Array:
    """Share of the light that a dielectric's interface reflects towards NoV, from above; the rest reaches the pigment.

    A bound of int D V F NoL dl, so that diffuse and specular reflection together never return more than they got: at
    most 1e-3 below it, and 0.02 above it on average where roughness > 0.6. Fit of this project.
    """
    t = np.clip((np.asarray(roughness, dtype=np.float64) - 0.32) / 0.42, 0.0, 1.0)
    grazing = 1.04 - (1.04 - 0.122) * t * t * (3 - 2 * t)
    share = DIELECTRIC_F0 + (grazing - DIELECTRIC_F0) * (1 - np.asarray(NoV)) ** 5
    return np.minimum(share, 1.0)


def brdf(
    normal: Array, view: Array, light: Array, *, albedo: Array, roughness: Array, metallic: Array, convention: str
) -> Array:
    """Reflected radiance over incoming irradiance f_r [1/sr].

    Parameters
    ----------
    normal, view, light
        Unit vectors (..., 3): of the surface, to the eye, to the light.
    albedo
        (..., 3), 0 to 1.
    roughness, metallic
        (...,), 0 to 1.
    convention
        "physical": c (1 - m) (1 - s) / pi + D V F, where s is the interface's share of the light. "paper": s = 0, and
        the specular term divided by 4 NoV NoL once more, as printed.

    Returns
    -------
    ndarray
        (..., 3); 0 where the light is behind the surface. NoV is taken for at least 1e-4.
    """
    NoL, NoV = _dot(normal, light), np.clip(_dot(normal, view), MIN_NOV, 1.0)
    h = light + view
    length = np.linalg.norm(h, axis=-1, keepdims=True)
    h = h / np.maximum(length, 1e-9)  # where the eye looks along the light, behind the surface, there is no half vector
    LoH = np.minimum(length[..., 0] / 2, 1.0)  # |l + v|^2 = 2 (1 + l.v) = 4 LoH^2
    alpha = alpha_of(roughness)
    lit = NoL > 0
    NoL = np.where(lit, NoL, 1.0)
    specular = D_GGX(normal, h, alpha) * V_SmithGGXCorrelated(NoV, NoL, alpha)
    pigment = (1 - metallic) / np.pi
    if convention == "paper":
        specular = specular / (4 * NoV * NoL)
    else:
        pigment = pigment * (1 - interface_share(NoV, roughness))
    f0 = DIELECTRIC_F0 + (albedo - DIELECTRIC_F0) * metallic[..., None]
    diffuse = albedo * pigment[..., None]
    f_r = diffuse + specular[..., None] * F_Schlick(f0, LoH[..., None])
    return np.where(lit[..., None], f_r, 0.0)


def _dot(a: Array, b: Array) -> Array:
    return np.einsum("...c,...c->...", a, b)
