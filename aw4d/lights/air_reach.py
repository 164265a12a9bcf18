"""Distances beside a lamp within which its light in the air shows: in thin haze a faint one has little, or none."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from aw4d.camera import Camera
from aw4d.lights.light import KINDS, LightArrays
from aw4d.params import FogParams
from reference_numpy.fog import along_ray
from reference_numpy.lamp import lamp
from reference_numpy.phase import henyey_greenstein
from reference_numpy.sampling import gauss_legendre

GRID = (19, 33)  # rays, up and across
MARGIN = 0.1  # of the picture to every side: the glow of a lamp in there peaks at one ray, which a grid may miss
Lens = tuple[tuple[int, int], tuple[float, ...]]  # size of the picture, (height, width) [px], and K row by row
ANGLES = 200  # nodes of the phase function's integral: to 2e-4 at |g| = 0.999, the largest that is admitted


def air_reach(lights: LightArrays, camera: Camera, fog: FogParams) -> NDArray[np.float32]:
    """Distance between lamp and ray within which the fog takes a light [m], (L,); 0 for none of it, inf for all.

    A ray that passes a lamp at distance D gathers at most b / D times the integral of the phase function over all
    angles, b being what the lamp's intensity scatters a metre: beyond the distance where that is `fog.faintest` nobody
    sees it. A lamp outside the picture is left out if a grid of rays without end finds it nowhere as bright.
    """
    scattering = fog.gamma * fog.alpha * float(fog.sigma_s or 0.0)
    brightest = scattering * lights.light_intensity.max(axis=1, initial=0.0).astype(np.float64)
    local = lights.light_kind != KINDS.index("directional")
    reach = np.full(len(lights), np.inf)
    if fog.faintest > 0:
        reach[local] = brightest[local] * _angular_integral(fog.g) / fog.faintest
    lens = camera.shape, tuple(camera.K.ravel().tolist())
    for i in np.flatnonzero(local & _outside(lights, camera)):
        if brightest[i] * _glow(_alone(lights, int(i)), lens, fog) <= fog.faintest:
            reach[i] = 0.0
    return reach.astype(np.float32)


@lru_cache(maxsize=16)
def _angular_integral(g: float) -> float:
    """Integral of the phase function over the scattering angle, 0 to pi [1/sr rad]."""
    x, w = gauss_legendre(ANGLES)
    return float(np.pi / 2 * (w * henyey_greenstein(np.cos(np.pi / 2 * (1 + x)), g=g)).sum())


def _alone(lights: LightArrays, i: int) -> tuple[tuple[str, tuple[float, ...]], ...]:
    """What tells where a lamp shines: the arguments of `lamp`, and their values of this one."""
    names = ("kind", "position", "direction", "cos_inner", "cos_outer", "r_max")
    return tuple((f"light_{name}", tuple(np.ravel(getattr(lights, f"light_{name}")[i]).tolist())) for name in names)


@lru_cache(maxsize=256)  # headlights stay where they are before the camera
def _glow(alone: tuple[tuple[str, tuple[float, ...]], ...], lens: Lens, fog: FogParams) -> float:
    """The most that a ray of the camera gathers of a lamp of unit intensity [1/m]."""
    rays = _rays(lens)
    source = lamp(0, **{name: np.array(value)[None] if len(value) > 1 else np.array(value) for name, value in alone})
    endless = np.full(rays.shape[:-1], fog.extent_m)
    return float(along_ray(source, rays, endless, extinction=fog.extinction, g=fog.g, nodes=fog.nodes).max())


def _rays(lens: Lens) -> NDArray[np.float64]:
    shape, K = lens
    v, u = (np.linspace(0, size - 1, count) for size, count in zip(shape, GRID, strict=True))
    pixel = np.stack([*np.meshgrid(u, v), np.ones(GRID)], axis=-1)
    ray = pixel @ np.linalg.inv(np.reshape(K, (3, 3))).T
    return np.asarray(ray / np.linalg.norm(ray, axis=-1, keepdims=True), dtype=np.float64)


def _outside(lights: LightArrays, camera: Camera) -> NDArray[np.bool_]:
    """Lamps whose place is not in the picture nor near it."""
    seen = camera.project(lights.light_position)
    size = np.array([camera.width, camera.height])
    with np.errstate(invalid="ignore"):  # a lamp behind the eye is at no pixel
        near = ((seen[:, :2] > -MARGIN * size) & (seen[:, :2] < (1 + MARGIN) * size)).all(axis=1)
    return np.asarray(~near, dtype=np.bool_)
