"""Fog with eight spot lights and eight nodes at 1280x704: NumPy against every OpenCL device, and the machine's limit.

Run as `python -m tests.bench.fog`. Every figure comes from this one process: medians of repeated runs, after a warm-up;
float32 multiply-adds a second measured on the same device.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from aw4d import opencl, street
from aw4d.backend_numpy import NumpyBackend
from aw4d.backend_opencl import OpenCLBackend
from aw4d.compare import error
from aw4d.gbuffer import GBuffer
from aw4d.lights.ego import headlights
from aw4d.lights.light import Light, LightArrays, in_camera
from aw4d.params import FogParams, HeadlightParams
from aw4d.passes import PASSES
from aw4d.scene import Scene

WIDTH, HEIGHT = 1280, 704
# Arithmetic of cl/fog.cl, a multiply-add counted as two, every built-in (exp, rsqrt, sqrt, division) as one; selects,
# comparisons and conversions are not counted.
NODE_OPS = 66
LIGHT_OPS = 38  # geometry of the ray and the lamp, up to the test of the cone
INTERVAL_OPS = 170  # angles of the stretch, where it is lit
PIXEL_OPS = 40

_FMA = """
__kernel void fma_rate(__global float16 *out, const int n)
{
    float16 a = (float16)(get_global_id(0)), b = a + 1, c = a + 2, d = a + 3;
    float16 e = a + 4, f = a + 5, g = a + 6, h = a + 7;
    const float16 k = 0.999f, m = 0.001f;
    for (int i = 0; i < n; i++) {
        a = fma(a, k, m); b = fma(b, k, m); c = fma(c, k, m); d = fma(d, k, m);
        e = fma(e, k, m); f = fma(f, k, m); g = fma(g, k, m); h = fma(h, k, m);
    }
    out[get_global_id(0)] = a + b + c + d + e + f + g + h;
}
"""


def fma_rate(backend: OpenCLBackend) -> float:
    """Float32 operations a second of eight independent chains of multiply-adds."""
    cl = opencl.load()
    context = cl.Context([backend.report.device])
    queue = cl.CommandQueue(context)
    kernel = cl.Kernel(cl.Program(context, _FMA).build(cache_dir=False), "fma_rate")
    items, steps = 4096, 20_000
    out = cl.Buffer(context, cl.mem_flags.WRITE_ONLY, items * 64)

    def run() -> None:
        kernel(queue, (items,), None, out, np.int32(steps))
        queue.finish()

    return items * steps * 8 * 16 * 2 / min(_times(run, 5))


def _times(run: Callable[[], None], count: int) -> list[float]:
    run()
    seconds = []
    for _ in range(count):
        start = time.perf_counter()
        run()
        seconds.append(time.perf_counter() - start)
    return seconds


def lights_of(source: GBuffer) -> LightArrays:
    """The six street lamps ahead that are nearest, and the ego vehicle's pair."""
    heads = source.camera.to_camera(street.lamps())
    ahead = heads[heads[:, 2] > 0]
    nearest = ahead[np.argsort(np.linalg.norm(ahead, axis=1))[:6]]
    hanging = [
        Light(
            kind="spot",
            position=tuple(p),
            direction=(0.0, 1.0, 0.0),
            intensity=(30.0, 25.0, 18.0),
            r_max_m=20,
            frame="camera",
        )
        for p in nearest.tolist()
    ]
    return in_camera(hanging + headlights(HeadlightParams(), white_cd_m2=12), source.camera)


def _operations(source: Any, lights: LightArrays, p: FogParams) -> float:
    """Operations that the definition asks for: nodes only where a light reaches a ray."""
    lit = 0
    numpy = NumpyBackend()
    for i in range(len(lights)):
        one = LightArrays(**{name: value[i : i + 1] for name, value in vars(lights).items()})
        planes = numpy.upload(source, Scene(lights=one))
        numpy.run("fog", planes, p)
        lit += int(np.count_nonzero(planes.arrays["in_scatter"][..., 0]))
    pixels = WIDTH * HEIGHT
    return lit * (p.nodes * NODE_OPS + INTERVAL_OPS) + len(lights) * pixels * LIGHT_OPS + pixels * PIXEL_OPS


def everywhere(source: GBuffer) -> LightArrays:
    """Eight wide spots at the eye: each reaches every pixel."""
    spots = [
        Light(
            kind="spot",
            position=(0.2 * i - 0.7, -0.5, -1.0),
            direction=(0.0, 0.0, 1.0),
            intensity=(9.0, 9.0, 9.0),
            inner_deg=60,
            outer_deg=80,
            r_max_m=500,
            frame="camera",
        )
        for i in range(8)
    ]
    return in_camera(spots, source.camera)


def main() -> None:
    """Measure and print."""
    whole = street.frame(28, width=WIDTH, height=HEIGHT)
    planes_read = {name: whole[name] for name in PASSES["fog"].reads}
    source = GBuffer(planes_read, camera=whole.camera, time=whole.time)
    _scene("lamps and headlights of the street", source, lights_of(source))
    _scene("every light reaches every pixel", source, everywhere(source))


def _scene(name: str, source: GBuffer, lights: LightArrays) -> None:
    p = FogParams(visibility_m=60, nodes=8, color=(0.5, 0.5, 0.5))
    numpy = NumpyBackend()
    planes = numpy.upload(source, Scene(lights=lights))

    def on_numpy() -> None:
        planes.arrays["rgb"] = source["rgb"].astype(np.float64)
        numpy.run("fog", planes, p)

    reference_s = float(np.median(_times(on_numpy, 5)))
    truth = numpy.download64(planes, ["rgb"])["rgb"]
    operations = _operations(source, lights, p)
    print(f"{name}: {len(lights)} spot lights, {p.nodes} nodes, {WIDTH}x{HEIGHT}, {operations / 1e9:.2f} G operations")
    print(f"{'numpy, float64':<40}{reference_s * 1e3:10.1f} ms")
    for report in opencl.devices():
        if not report.usable:
            print(f"{report.label}: refused ({report.problem})")
            continue
        for width in opencl.WIDTHS if report.kind == "cpu" else (1,):
            _measure(OpenCLBackend(report.index, width), source, lights, p, reference_s, truth, operations)


def _measure(
    backend: OpenCLBackend,
    source: Any,
    lights: LightArrays,
    p: FogParams,
    reference_s: float,
    truth: Any,
    operations: float,
) -> None:
    planes = backend.upload(source, Scene(lights=lights))
    backend.run("fog", planes, p)
    largest, p9999 = error(backend.download(planes, ["rgb"])["rgb"], truth)

    def on_device() -> None:
        backend.run("fog", planes, p)
        backend.finish()

    seconds = float(np.median(_times(on_device, 15)))
    limit = fma_rate(backend)
    print(
        f"{backend.report.platform[:28]:<30}x{backend.width:<9}{seconds * 1e3:10.1f} ms"
        f"  {reference_s / seconds:6.0f} x numpy"
        f"  {operations / seconds / 1e9:6.1f} of {limit / 1e9:.0f} GFLOP/s = {operations / seconds / limit:4.0%}"
        f"  error {largest:.1e} max, {p9999:.1e} p99.99"
    )


if __name__ == "__main__":
    main()
