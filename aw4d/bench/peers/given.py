"""What a peer is given: planar float32 planes, the camera, lights and parameters as plain numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aw4d.backend_numpy import NumpyBackend, NumpyPlanes
from aw4d.gbuffer import GBuffer
from aw4d.params import Params
from aw4d.passes import EMPTY, PASSES, held_as
from aw4d.scene import Scene
from reference_numpy.sampling import gauss_legendre

PEERED = ("spot_lights", "fog", "harmonize", "overcast_sky", "wet_ground")
RESULT = {"spot_lights": "direct", "wet_ground": "albedo"}  # the plane that is compared; `rgb` of the others


@dataclass(frozen=True, kw_only=True)
class Given:
    """A pass and all that it takes; `planes` are (H, W) or (3, H, W)."""

    step: str
    frame: GBuffer
    scene: Scene
    params: Params
    planes: dict[str, NDArray[Any]]

    @property
    def result(self) -> str:
        """The plane that is compared."""
        return RESULT.get(self.step, "rgb")

    @property
    def camera(self) -> tuple[float, float, float, float]:
        """fx, fy, cx, cy [px]."""
        K = self.frame.camera.K
        return float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2])

    @property
    def light_table(self) -> NDArray[np.float32]:
        """A row a spot: position, direction, cos_outer, 1 / (cos_inner - cos_outer), r_max, intensity; (L, 12)."""
        held = self.scene.lights
        inv_cone = 1 / (held.light_cos_inner.astype(np.float64) - held.light_cos_outer)
        columns: list[NDArray[Any]] = [
            held.light_position,
            held.light_direction,
            held.light_cos_outer[:, None],
            inv_cone[:, None],
        ]
        columns += [held.light_r_max[:, None], held.light_intensity]
        return np.concatenate(columns, axis=1).astype(np.float32)

    @property
    def nodes(self) -> tuple[list[float], list[float]]:
        """Abscissae and weights of the fog's quadrature."""
        x, w = gauss_legendre(self.params.arguments()["nodes"])
        return x.tolist(), w.tolist()

    def reference(self) -> tuple[NumpyBackend, NumpyPlanes]:
        """The float64 reference and its planes."""
        backend = NumpyBackend()
        return backend, backend.upload(self.frame, self.scene)


def given(step: str, frame: GBuffer, scene: Scene, params: Params) -> Given:
    """A pass on a frame."""
    planes = {}
    for name in PASSES[step].reads:
        if name in frame:
            planes[name] = planar(frame[name])
        else:
            channels, dtype = held_as(name)
            shape = frame.camera.shape if channels == 1 else (channels, *frame.camera.shape)
            planes[name] = np.full(shape, EMPTY.get(name, 0), dtype)
    return Given(step=step, frame=frame, scene=scene, params=params, planes=planes)


def planar(values: NDArray[Any]) -> NDArray[Any]:
    """(H, W) as it is, (H, W, 3) channel after channel."""
    return np.ascontiguousarray(values if values.ndim == 2 else np.moveaxis(values, -1, 0))
