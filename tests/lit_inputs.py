"""Frames with every plane that light needs, and reference runs, for the tests of the local lights."""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aw4d.backend import frame_arguments
from aw4d.gbuffer import GBuffer
from aw4d.lights.light import Light, LightArrays, in_camera
from aw4d.params import SpotLightsParams
from aw4d.scene import Scene
from reference_numpy.spot_lights import spot_lights
from tests.fog_inputs import EYE, all_kinds, camera, street_lamps

__all__ = ["all_kinds", "arguments", "frame", "inherent_error", "on", "reference", "street_lamps", "unchecked"]

PERTURBATIONS = 16
AS_THEY_ARE = ("convention", "light_kind", "sky")


def frame(width: int = 96, height: int = 54, seed: int = 0, pose: NDArray[np.float64] = EYE, **planes: Any) -> GBuffer:
    """Random materials on a ragged wall 2 to 120 m away, a third of it sky; `planes` replace what is drawn."""
    rng = np.random.default_rng(seed)
    size = (height, width)
    seen = camera(width, height, pose)
    ray = seen.rays() / np.linalg.norm(seen.rays(), axis=-1, keepdims=True)
    tilted = rng.normal(size=(*size, 3)) * 0.5 - ray
    tilted *= -np.sign(np.einsum("...c,...c", tilted, ray))[..., None]  # faces the eye
    drawn = {
        "depth": np.exp(rng.uniform(np.log(2), np.log(120), size)).astype(np.float32),
        "normal": (tilted / np.linalg.norm(tilted, axis=-1, keepdims=True)).astype(np.float32),
        "albedo": rng.random((*size, 3), dtype=np.float32),
        "roughness": rng.random(size, dtype=np.float32),
        "metallic": (rng.random(size, dtype=np.float32) < 0.3).astype(np.float32),
        "emissive": (rng.random((*size, 3), dtype=np.float32) * (rng.random((*size, 1)) < 0.05)).astype(np.float32),
        "sky": np.arange(height)[:, None] < np.full(width, height / 3),
    }
    return GBuffer(drawn | planes, camera=seen, time=0.0)


def unchecked(source: GBuffer, **planes: Any) -> GBuffer:
    """The frame with planes that a `GBuffer` refuses, as resampling may leave them."""
    loose = GBuffer(source, camera=source.camera, time=source.time)
    loose._planes.update(planes)
    return loose


def arguments(source: GBuffer, lights: Sequence[Light], p: SpotLightsParams) -> dict[str, Any]:
    """Arguments of the reference in float64, from the float32 inputs that every backend gets."""
    given = dict(source) | frame_arguments(source, Scene(lights=in_camera(lights, source.camera))) | p.arguments()
    names = inspect.signature(spot_lights).parameters
    return {name: _widen(given[name]) for name in names}


def _widen(value: Any) -> Any:
    return value.astype(np.float64) if getattr(value, "dtype", None) == np.float32 else value


def reference(source: GBuffer, lights: Sequence[Light], p: SpotLightsParams) -> NDArray[np.float64]:
    """The definition of the result."""
    return spot_lights(**arguments(source, lights, p))["direct"]


def inherent_error(source: GBuffer, lights: Sequence[Light], p: SpotLightsParams) -> NDArray[np.float64]:
    """How far the result moves when every input moves by 16 x 2^-24 of itself; the worst of some draws of the signs.

    This is 16 x 2^-24 times the condition number, pixel by pixel, measured in float64. At a step, as the printed form
    has one where n.l = 0, it is the step's height.
    """
    exact = arguments(source, lights, p)
    truth = spot_lights(**exact)["direct"]
    rng = np.random.default_rng(1)
    worst = np.zeros_like(truth)
    for _ in range(PERTURBATIONS):
        moved = spot_lights(**{name: _nudged(name, value, rng) for name, value in exact.items()})["direct"]
        worst = np.maximum(worst, np.abs(moved - truth))
    return worst


def _nudged(name: str, value: Any, rng: np.random.Generator) -> Any:
    if name in AS_THEY_ARE:
        return value
    return value * (1 + 16 * 2.0**-24 * rng.choice([-1.0, 1.0], size=np.shape(value)))


def on(backend: Any, source: GBuffer, lights: Sequence[Light], p: SpotLightsParams) -> NDArray[np.float32]:
    """The result of a backend."""
    arrays: LightArrays = in_camera(lights, source.camera)
    planes = backend.upload(source, Scene(lights=arrays))
    backend.run("spot_lights", planes, p)
    return np.asarray(backend.download(planes, ["direct"])["direct"])
