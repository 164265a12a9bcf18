"""Which lamps light the air: a lamp beside the picture whose beam nobody would see in a thin haze is left out of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from aw4d.camera import Camera
from aw4d.lights.light import KINDS, LightArrays
from aw4d.params import FogParams
from reference_numpy.fog import along_ray
from reference_numpy.lamp import lamp

GRID = (19, 33)  # rays, up and across
MARGIN = 0.1  # of the picture to every side: a lamp in there is never left out, since its glow peaks at one ray


def in_air(lights: LightArrays, camera: Camera, fog: FogParams) -> NDArray[np.int32]:
    """1 for every light that the fog takes, 0 for those that are too faint, (L,).

    A lamp is left out if it stands outside the picture and a grid of rays without end finds its single scattering
    nowhere above `fog.faintest`. Its glow has no peak within the picture then, so the grid misses little of it.
    """
    taken = np.ones(len(lights), dtype=np.int32)
    rays = _rays(camera)
    for i in np.flatnonzero(_outside(lights, camera)):
        source = lamp(
            int(i),
            light_kind=lights.light_kind,
            light_position=lights.light_position.astype(np.float64),
            light_direction=lights.light_direction.astype(np.float64),
            light_cos_inner=lights.light_cos_inner.astype(np.float64),
            light_cos_outer=lights.light_cos_outer.astype(np.float64),
            light_r_max=lights.light_r_max.astype(np.float64),
        )
        endless = np.full(rays.shape[:-1], fog.extent_m)
        glow = along_ray(source, rays, endless, extinction=fog.extinction, g=fog.g, nodes=fog.nodes)
        scattering = fog.alpha * float(fog.sigma_s or 0.0)
        taken[i] = fog.gamma * scattering * glow.max() * lights.light_intensity[i].max() > fog.faintest
    return taken


def _rays(camera: Camera) -> NDArray[np.float64]:
    v, u = (np.linspace(0, size - 1, count) for size, count in zip(camera.shape, GRID, strict=True))
    pixel = np.stack([*np.meshgrid(u, v), np.ones(GRID)], axis=-1)
    ray = pixel @ np.linalg.inv(camera.K).T
    return np.asarray(ray / np.linalg.norm(ray, axis=-1, keepdims=True), dtype=np.float64)


def _outside(lights: LightArrays, camera: Camera) -> NDArray[np.bool_]:
    """Lamps whose place is not in the picture nor near it; light from a direction is everywhere."""
    seen = camera.project(lights.light_position)
    size = np.array([camera.width, camera.height])
    with np.errstate(invalid="ignore"):  # a lamp behind the eye is at no pixel
        near = ((seen[:, :2] > -MARGIN * size) & (seen[:, :2] < (1 + MARGIN) * size)).all(axis=1)
    return ~near & (lights.light_kind != KINDS.index("directional"))
