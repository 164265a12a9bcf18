"""Frames, lights and reference runs for the tests of the fog."""

from __future__ import annotations

import inspect
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aw4d.backend import frame_arguments
from aw4d.camera import Camera
from aw4d.gbuffer import GBuffer
from aw4d.lights.light import Light, LightArrays, in_camera
from aw4d.params import FogParams
from aw4d.scene import Scene
from reference_numpy.fog import fog

EYE = np.eye(4)
RESULTS = ("rgb", "transmittance", "in_scatter", "airlight")
PERTURBATIONS = 8


def camera(width: int, height: int, pose: NDArray[np.float64] = EYE) -> Camera:
    """A camera that sees about 65 degrees, its centre off the pixel grid."""
    K = np.array([[0.8 * width + 1, 0, width / 2 - 0.3], [0, 0.8 * width + 1, height / 2 + 0.2], [0, 0, 1]])
    return Camera(width=width, height=height, K=K, camera_to_world=pose)


def frame(width: int = 96, height: int = 54, seed: int = 0, pose: NDArray[np.float64] = EYE, **planes: Any) -> GBuffer:
    """Random colours on a ragged wall 2 to 120 m away, a third of it sky; `planes` replace what is drawn."""
    rng = np.random.default_rng(seed)
    drawn = {
        "rgb": rng.random((height, width, 3), dtype=np.float32),
        "depth": np.exp(rng.uniform(np.log(2), np.log(120), (height, width))).astype(np.float32),
        "sky": np.arange(height)[:, None] < np.full(width, height / 3),
    }
    return GBuffer(drawn | planes, camera=camera(width, height, pose), time=0.0)


def street_lamps(count: int = 8) -> list[Light]:
    """Lamps left and right of the view that shine down, slightly tilted."""
    return [
        Light(
            kind="spot",
            position=(-5.0 if i % 2 else 5.0, -5.0, 8.0 + 7 * i),
            direction=(0.02, 1.0, 0.05),
            intensity=(30.0, 25.0, 18.0),
            inner_deg=15,
            outer_deg=35,
            r_max_m=15,
            frame="camera",
        )
        for i in range(count)
    ]


def all_kinds() -> list[Light]:
    """A sun, a bare bulb and a headlight-like spot at the eye."""
    return [
        Light(kind="directional", direction=(0.3, 1.0, 0.4), intensity=(2.0, 1.9, 1.7), frame="camera"),
        Light(kind="point", position=(2.0, -1.0, 12.0), intensity=(20.0, 20.0, 20.0), r_max_m=30, frame="camera"),
        Light(
            kind="spot",
            position=(0.6, 0.9, 1.6),
            direction=(0.0, 0.02, 1.0),
            intensity=(200.0, 190.0, 170.0),
            inner_deg=10,
            outer_deg=25,
            r_max_m=50,
            frame="camera",
        ),
    ]


def arguments(source: GBuffer, lights: Sequence[Light], p: FogParams) -> dict[str, Any]:
    """Arguments of the reference in float64, from the float32 inputs that every backend gets."""
    given = dict(source) | frame_arguments(source, Scene(lights=in_camera(lights, source.camera))) | p.arguments()
    names = inspect.signature(fog).parameters
    return {name: _widen(given[name]) for name in names}


def _widen(value: Any) -> Any:
    return value.astype(np.float64) if getattr(value, "dtype", None) == np.float32 else value


def reference(source: GBuffer, lights: Sequence[Light], p: FogParams) -> dict[str, NDArray[np.float64]]:
    """The definition of the result."""
    return fog(**arguments(source, lights, p))


def inherent_error(source: GBuffer, lights: Sequence[Light], p: FogParams) -> dict[str, NDArray[np.float64]]:
    """How far each result moves when every input moves by 2^-24 of itself, half a float32 ulp; the worst of some draws.

    This is 2^-24 times the condition number, pixel by pixel, measured in float64.
    """
    exact = arguments(source, lights, p)
    truth = fog(**exact)
    rng = np.random.default_rng(1)
    worst = {name: np.zeros_like(truth[name]) for name in RESULTS}
    for _ in range(PERTURBATIONS):
        moved = fog(**{name: _nudged(name, value, rng) for name, value in exact.items()})
        for name in RESULTS:
            worst[name] = np.maximum(worst[name], np.abs(moved[name] - truth[name]))
    return worst


def _nudged(name: str, value: Any, rng: np.random.Generator) -> Any:
    if name in ("nodes", "convention", "light_kind", "sky", "color"):
        return value
    sign = rng.choice([-1.0, 1.0], size=np.shape(value))
    return value * (1 + 2.0**-24 * sign)


def on(backend: Any, source: GBuffer, lights: Sequence[Light], p: FogParams) -> Mapping[str, NDArray[np.float32]]:
    """Every result of a backend."""
    arrays: LightArrays = in_camera(lights, source.camera)
    planes = backend.upload(source, Scene(lights=arrays), RESULTS[1:])
    backend.run("fog", planes, p)
    return backend.download(planes, RESULTS)
