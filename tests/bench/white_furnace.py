"""White furnace: what share of the light around a surface its BRDF sends to the eye. Above 1 it makes light.

Run as `python -m tests.bench.white_furnace`: this project's form against the printed one, which divides by 4 NoV NoL
although its G is the visibility V = G / (4 NoV NoL) already.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from reference_numpy.brdf import D_GGX, MIN_NOV, alpha_of, brdf

Array = NDArray[np.float64]

ROUGHNESS = (0.0, 0.045, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0)
NOV = (1e-4, 0.01, 0.05, 0.3, 0.7, 1.0)
NORMAL = np.array([0.0, 0.0, 1.0])


def furnace(
    convention: str, roughness: float, NoV: float, *, metallic: float = 1.0, albedo: float = 1.0, nodes: int = 400
) -> float:
    """Integral of f_r NoL over the hemisphere, in float64.

    Two quadratures share the integrand by the balance heuristic (Veach and Guibas 1995): one as dense as the
    microfacets' normals, one as dense as the cosine. Each has nodes x nodes points.
    """
    view = np.array([np.sqrt(1 - NoV**2), 0.0, NoV])
    middle = (np.arange(nodes) + 0.5) / nodes
    u, phi = (grid.ravel() for grid in np.meshgrid(middle, 2 * np.pi * middle, indexing="ij"))
    a2 = float(alpha_of(roughness)) ** 2
    h = _direction(np.sqrt((1 - u) / (1 - u + a2 * u)), phi)  # of density D NoH
    mirrored = 2 * (h @ view)[:, None] * h - view
    total = 0.0
    for light in (mirrored[mirrored[:, 2] > 0], _direction(np.sqrt(u), phi)):
        f_r = brdf(
            NORMAL,
            view,
            light,
            albedo=np.full(3, albedo),
            roughness=np.array(roughness),
            metallic=np.array(metallic),
            convention=convention,
        )
        total += float((f_r[:, 0] * light[:, 2] / _density(light, view, roughness)).sum())
    return total / nodes**2


def _direction(cos: Array, phi: Array) -> Array:
    sin = np.sqrt(np.maximum(1 - cos**2, 0))
    return np.stack([sin * np.cos(phi), sin * np.sin(phi), cos], axis=-1)


def _density(light: Array, view: Array, roughness: float) -> Array:
    """Sum of the two quadratures' densities at directions (n, 3) [1/sr]."""
    h = light + view
    h = h / np.linalg.norm(h, axis=-1, keepdims=True)
    microfacets = D_GGX(NORMAL, h, alpha_of(roughness)) * h[:, 2] / (4 * (h @ view))
    return np.asarray(microfacets + light[:, 2] / np.pi)


def main() -> None:
    """Print both forms, a white metal: roughness down, NoV across."""
    print(f"{'':24}" + "".join(f"n.v {NoV:<9g}" for NoV in NOV))
    for convention in ("physical", "paper"):
        for roughness in ROUGHNESS:
            shares = "".join(f"{furnace(convention, roughness, max(NoV, MIN_NOV)):<13.4g}" for NoV in NOV)
            print(f"{convention:10}roughness {roughness:<6g}{shares}".rstrip())


if __name__ == "__main__":
    main()
