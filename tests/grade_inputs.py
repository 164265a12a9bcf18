"""Frames, runs and the error bar for the tests of the passes that look at no geometry."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aw4d.compare import BAR_MAX, BAR_P9999, error
from aw4d.gbuffer import GBuffer
from aw4d.lights.light import in_camera
from aw4d.params import Params
from aw4d.passes import PASSES
from aw4d.scene import Scene
from tests import fog_inputs

SIZES = [(1, 1), (1, 9), (9, 1), (13, 7), (15, 3), (16, 3), (17, 3), (31, 2), (32, 2), (33, 2), (129, 70)]


def frame(width: int = 96, height: int = 54, seed: int = 0, **planes: Any) -> GBuffer:
    """Random colours, the upper third sky with a ragged edge; `planes` replace what is drawn."""
    rng = np.random.default_rng(seed)
    edge = height / 3 + rng.integers(-2, 3, width)
    drawn = {
        "rgb": rng.random((height, width, 3), dtype=np.float32) ** 3,
        "sky": np.arange(height)[:, None] < edge,
    }
    return GBuffer(drawn | planes, camera=fog_inputs.camera(width, height), time=0.0)


def reference(name: str, source: GBuffer, p: Params, **working: NDArray[np.float32]) -> dict[str, NDArray[np.float64]]:
    """The definition of the result, in float64, from the float32 inputs that every backend gets."""
    function = getattr(importlib.import_module(f"reference_numpy.{name}"), name)
    given = dict(source) | working | p.arguments()
    widened = {key: v.astype(np.float64) if getattr(v, "dtype", None) == np.float32 else v for key, v in given.items()}
    return function(**{key: widened[key] for key in inspect.signature(function).parameters})


def on(
    backend: Any, name: str, source: GBuffer, p: Params, *, layers: bool = True, **working: NDArray[np.float32]
) -> Mapping[str, NDArray[np.float32]]:
    """What an OpenCL backend makes of it; `working` are planes that another pass would have written."""
    wanted = list(PASSES[name].layers) if layers else []
    planes = backend.upload(source, Scene(lights=in_camera([], source.camera)), wanted)
    for key, values in working.items():
        room = planes.pitch - values.shape[1]
        planar = np.pad(np.moveaxis(values, -1, 0), ((0, 0), (0, 0), (0, room)), mode="edge")
        planes.buffers[key] = backend._to_device(key, planar)
    backend.run(name, planes, p)
    return backend.download(planes, ["rgb", *wanted])


def check(
    backend: Any,
    name: str,
    source: GBuffer,
    p: Params,
    *,
    inherent: NDArray[np.float64] | None = None,
    **working: NDArray[np.float32],
) -> None:
    """The error bar on every result, with layers and without.

    With `inherent`, how far the picture moves with half an ulp of the inputs, it may be off by 16 times that much more.
    """
    truth = reference(name, source, p, **working)
    for layers in (True, False):
        for key, found in on(backend, name, source, p, layers=layers, **working).items():
            assert np.isfinite(found).all(), key
            assert (found >= 0).all(), key
            off = np.abs(found - truth[key])
            if inherent is not None and key == "rgb":
                off = np.maximum(off - 16 * inherent, 0)
            largest, p9999 = error(truth[key] + off, truth[key])
            assert largest <= BAR_MAX, f"{key}: {largest:.2e}"
            assert p9999 <= BAR_P9999, f"{key}: {p9999:.2e}"
