"""How faint a lamp's light in the air may be before it is taken for nothing: in thin haze by day most of it is."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from aw4d.camera import Camera
from aw4d.lights.light import KINDS, LightArrays
from aw4d.params import RGB, FogParams
from reference_numpy.fog import along_ray
from reference_numpy.lamp import lamp

GRID = (19, 33)  # rays, up and across
MARGIN = 0.1  # of the picture to every side: the glow of a lamp in there peaks at one ray, which a grid may miss
Lens = tuple[tuple[int, int], tuple[float, ...]]  # size of the picture, (height, width) [px], and K row by row
LOST = 1.39002  # times the floor: the most that fades of a glow, g (1 - (1 - 1 / g^2)^4) at g = 1.746
DAY = 0.5  # [white] mean radiance of the surroundings under which `faintest` is meant
DARK = 0.1  # of the surroundings' mean radiance: what glow is seen against


def air_floor(lights: LightArrays, camera: Camera, fog: FogParams) -> NDArray[np.float32]:
    """Single scattering at unit intensity that is taken for nothing [1/(m sr)], (L,); 0 takes all, inf nothing.

    Of what the light's intensity scatters a metre no more than `fog.faintest` is lost. A lamp outside the picture is
    left out if a grid of rays without end finds it nowhere brighter than that.
    """
    scattering = fog.gamma * fog.alpha * float(fog.sigma_s or 0.0)
    brightest = scattering * lights.light_intensity.max(axis=1, initial=0.0).astype(np.float64)
    local = lights.light_kind != KINDS.index("directional")
    floor = np.zeros(len(lights))
    if fog.faintest > 0:
        with np.errstate(divide="ignore"):  # a lamp without intensity
            floor[local] = fog.faintest / LOST * _dimmed(fog.color) / brightest[local]
    lens = camera.shape, tuple(camera.K.ravel().tolist())
    for i in np.flatnonzero(local & _outside(lights, camera)):
        if _glow(_alone(lights, int(i)), lens, fog) <= LOST * floor[i]:
            floor[i] = np.inf
    return floor.astype(np.float32)


def _dimmed(color: RGB | None) -> float:
    """How much fainter than by day glow is seen before surroundings of that radiance: the ratio of the steps of sRGB's
    codes at a tenth of it, which go with L^(1 - 1/2.4) down to 0.0031308 (IEC 61966-2-1)."""
    if color is None:
        return 1.0
    step = [max(DARK * radiance, 0.0031308) ** (1 - 1 / 2.4) for radiance in (float(np.mean(color)), DAY)]
    return min(step[0] / step[1], 1.0)


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
