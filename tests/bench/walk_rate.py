"""What `reflections` cannot beat on a device: looking up the depths of all its steps, and doing nothing with them."""

from __future__ import annotations

import time
from importlib import resources

import numpy as np
from numpy.typing import NDArray

from aw4d import opencl
from aw4d.backend_opencl import OpenCLBackend, OpenCLPlanes
from aw4d.camera import Camera
from aw4d.params import ReflectionsParams
from reference_numpy.mirrored import Mirrored

RUNS = 15

_WALK = """
__kernel void walk_rate(
    __global const float *depth, __global const int *from, __global float *out, const int row, const int steps)
{
    const int i = get_global_id(0), u = from[2 * i], v = from[2 * i + 1];
    floatw deepest = 0.0f;
    for (int step = 1; step <= steps; step++) {
        __global const float *at = depth + (v - (step * step * v + steps * steps - 1) / (steps * steps)) * row + u;
        deepest = fmax(deepest, fmax(LOADW(at), LOADW(at + 1)));
    }
    STOREW(deepest, out + i * W);
}
"""


def mirroring(
    backend: OpenCLBackend, planes: OpenCLPlanes, camera: Camera, up: NDArray[np.float32], p: ReflectionsParams
) -> NDArray[np.int32]:
    """Columns and rows (N, 2) of the first pixels of all vectors of which one at least mirrors what is above it."""
    names = ["puddle", "wetness", "roughness", "normal", "depth"]
    found = {name: values.astype(np.float64) for name, values in backend.download(planes, names).items()}
    wet = np.maximum(found["puddle"], found["wetness"]) > 0
    v, u = np.nonzero(wet & (found["roughness"] < p.max_roughness))
    K = camera.K
    at = (found[name][v, u] for name in ("depth", "normal", "roughness"))
    rays = Mirrored(u, v, *at, K[0, 0], K[1, 1], K[0, 2], K[1, 2], up.astype(np.float64))
    kept = rays.fit > 0
    vectors = np.unique(np.stack([v[kept], u[kept] // backend.width], axis=-1), axis=0)
    return np.ascontiguousarray(vectors[:, ::-1] * [backend.width, 1], dtype=np.int32)


def seconds(backend: OpenCLBackend, shape: tuple[int, int], vectors: NDArray[np.int32], steps: int) -> float:
    """Fastest run of the look-ups alone."""
    cl = opencl.load()
    context = cl.Context([backend.report.device])
    queue = cl.CommandQueue(context)
    vec = resources.files("cl").joinpath("include", "vec.h").read_text(encoding="utf-8")
    kernel = cl.Kernel(cl.Program(context, vec + _WALK).build([f"-DW={backend.width}"], cache_dir=False), "walk_rate")
    row = -(-shape[1] // backend.width) * backend.width + 16
    flags = cl.mem_flags.READ_ONLY | cl.mem_flags.COPY_HOST_PTR
    depth = cl.Buffer(context, flags, hostbuf=np.ones((shape[0], row), np.float32))
    places = cl.Buffer(context, flags, hostbuf=vectors)
    out = cl.Buffer(context, cl.mem_flags.WRITE_ONLY, 4 * backend.width * len(vectors))
    took = []
    for _ in range(RUNS + 1):
        start = time.perf_counter()
        kernel(queue, (len(vectors),), None, depth, places, out, np.int32(row), np.int32(steps))
        queue.finish()
        took.append(time.perf_counter() - start)
    return min(took[1:])
