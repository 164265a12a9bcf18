"""Frames, places and runs for the tests of water on the ground."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aw4d.backend_numpy import NumpyBackend
from aw4d.compare import BAR_MAX, BAR_P9999, error
from aw4d.gbuffer import GBuffer
from aw4d.lights.light import in_camera
from aw4d.params import Params
from aw4d.passes import PASSES
from aw4d.scene import Scene
from aw4d.world import anchor
from tests.fog_inputs import camera

SIZES = [(1, 1), (1, 9), (9, 1), (13, 7), (15, 3), (16, 3), (17, 3), (33, 2), (129, 40)]
FAR = (520_000.0, 110.0, -4_100_000.0)  # [m] an origin as large as UTM's
HEIGHT = 1.6  # [m] of the camera above the road


def pose(x: float = 0.0, z: float = 0.0, yaw: float = 0.3, pitch: float = 0.12) -> NDArray[np.float64]:
    """A camera above the level road of the world, in which y points up, turned and tilted down [rad]."""
    c, s, cp, sp = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
    out = np.eye(4)
    right, ahead = np.array([c, 0.0, -s]), np.array([s * cp, -sp, c * cp])
    out[:3, :3] = np.stack([right, np.cross(ahead, right), ahead], axis=1)
    out[:3, 3] = x, HEIGHT, z
    return out


def frame(
    width: int = 96, height: int = 54, seed: int = 0, at: NDArray[np.float64] | None = None, **planes: Any
) -> GBuffer:
    """A level road with a ragged edge, its normals a few degrees off, under a sky; `planes` replace what is drawn."""
    rng = np.random.default_rng(seed)
    size, eye = (height, width), camera(width, height, pose() if at is None else at)
    R = eye.camera_to_world[:3, :3]
    fall = -(eye.rays() @ R.T)[..., 1]
    normal = R.T @ np.array([0.0, 1.0, 0.0]) + rng.normal(size=(*size, 3)) * 0.05
    drawn = {
        "depth": (HEIGHT / np.maximum(fall, HEIGHT / 150)).astype(np.float32),
        "normal": (normal / np.linalg.norm(normal, axis=-1, keepdims=True)).astype(np.float32),
        "albedo": rng.random((*size, 3), dtype=np.float32),
        "roughness": rng.random(size, dtype=np.float32),
        "metallic": (rng.random(size, dtype=np.float32) < 0.3).astype(np.float32),
        "sky": fall < 0.01,
        "road": (fall > 0.02) & (np.arange(width) < 0.8 * width + 4 * rng.random((height, 1))),
    }
    return GBuffer(drawn | planes, camera=eye, time=0.0)


def wall(distance: float, seed: int = 3, count: int = 100, focal: float = 80.0, ahead: float = 0.0) -> GBuffer:
    """A road that stands upright before a camera which looks down the world's z axis, from `ahead` farther on.

    Its normals are said to point up, so that all of it may be under water. The focal length shrinks with the distance:
    the same points are in the same pixels.
    """
    eye = camera(count, count)
    left = distance - ahead
    K = eye.K * np.array([[focal / eye.K[0, 0] * left / distance], [focal / eye.K[1, 1] * left / distance], [1.0]])
    K[:2, 2] = eye.K[:2, 2]
    at = np.eye(4)
    at[:3, :3] = tilted()
    at[:3, 3] = at[:3, 2] * ahead
    made = type(eye)(width=count, height=count, K=K, camera_to_world=at)
    size = (count, count)
    up = np.broadcast_to(at[1, :3], (*size, 3))
    planes = {
        "depth": np.full(size, left, dtype=np.float32),
        "normal": up.astype(np.float32),
        "albedo": np.full((*size, 3), 0.1, dtype=np.float32),
        "roughness": np.full(size, 0.9, dtype=np.float32),
        "sky": np.zeros(size, dtype=bool),
        "road": np.ones(size, dtype=bool),
    }
    return GBuffer(planes, camera=made, time=0.0)


def tilted() -> NDArray[np.float64]:
    """A rotation of no special angles, from a camera that looks down at the ground, to the world."""
    return np.asarray(pose(yaw=0.7, pitch=1.1)[:3, :3])


def scene(source: GBuffer, time: float = 0.0, origin: ArrayLike = (0.0, 0.0, 0.0)) -> Scene:
    """The frame's place in the world and in time; no light."""
    return Scene(lights=in_camera([], source.camera), world=anchor(source.camera, time, origin))


def run(
    backend: Any,
    name: str,
    source: GBuffer,
    p: Params,
    where: Scene | None = None,
    *,
    layers: bool = True,
    **working: NDArray[Any],
) -> Mapping[str, NDArray[Any]]:
    """What a backend makes of a frame; `working` are planes that another pass would have written. NumPy's: float64."""
    wanted = [*PASSES[name].layers] if layers else []
    planes = backend.upload(source, where or scene(source), wanted)
    for key, values in working.items():
        if isinstance(backend, NumpyBackend):
            planes.arrays[key] = values.astype(np.float64)
        else:
            room = planes.pitch - values.shape[1]
            planes.buffers[key] = backend._to_device(key, np.pad(values, ((0, 0), (0, room)), mode="edge"))
    backend.run(name, planes, p)
    get = backend.download64 if isinstance(backend, NumpyBackend) else backend.download
    out: Mapping[str, NDArray[Any]] = get(planes, list(dict.fromkeys([*PASSES[name].writes, *wanted])))
    return out


def reference(
    name: str, source: GBuffer, p: Params, where: Scene | None = None, **working: NDArray[Any]
) -> Mapping[str, NDArray[np.float64]]:
    """The definition of the result."""
    return run(NumpyBackend(), name, source, p, where, **working)


def check(
    backend: Any,
    name: str,
    source: GBuffer,
    p: Params,
    where: Scene | None = None,
    *,
    inherent: Mapping[str, NDArray[np.float64]] | None = None,
    **working: NDArray[Any],
) -> None:
    """The error bar on everything that the pass gives.

    With `inherent`, how far a plane moves with half an ulp of what it is made of, it may be off by 16 times that more.
    """
    truth = reference(name, source, p, where, **working)
    for key, found in run(backend, name, source, p, where, **working).items():
        assert np.isfinite(found).all(), key
        off = np.abs(found - truth[key])
        if inherent and key in inherent:
            off = np.maximum(off - 16 * inherent[key], 0)
        largest, p9999 = error(truth[key] + off, truth[key])
        assert largest <= BAR_MAX, f"{key}: {largest:.2e}"
        assert p9999 <= BAR_P9999, f"{key}: {p9999:.2e}"


def unchanged(found: Mapping[str, NDArray[Any]], source: GBuffer, names: Sequence[str]) -> bool:
    """Whether planes are as they were, to the bit."""
    return all(np.array_equal(found[name], source[name]) for name in names)
