"""Local lights at 1280x704: NumPy and PyTorch against every OpenCL device, the machine's limit, and many lamps.

Run as `python -m tests.bench.spot_lights`. Every figure comes from this one process, after a warm-up; float32
multiply-adds a second measured on the same device, between the runs. PyTorch is left out where it is not installed.
"""

from __future__ import annotations

import os
from importlib.util import find_spec
from typing import Any

import numpy as np

from aw4d import opencl, street
from aw4d.backend_numpy import NumpyBackend
from aw4d.backend_opencl import OpenCLBackend
from aw4d.compare import error
from aw4d.gbuffer import GBuffer
from aw4d.lights.light import Light, LightArrays, in_camera
from aw4d.params import SpotLightsParams
from aw4d.passes import PASSES
from aw4d.scene import Scene
from tests.bench.fog import HEIGHT, WIDTH, _times, everywhere, fma_rate, lights_of

# Arithmetic of the definition in reference_numpy, a multiply-add counted as two, a division or square root as one;
# clamps, selects and comparisons are not counted.
GEOMETRY_OPS = 34  # l, d, S, W, 1 / (d^2 + eps), n.l: every surface and light
REFLECTION_OPS = 74  # h, D, V, F, f_r and the sum: where light falls
PIXEL_OPS = 68
RUNS = 30
P = SpotLightsParams()


def _seconds(backend: OpenCLBackend, planes: Any) -> tuple[float, float]:
    """Fastest and median run."""

    def on_device() -> None:
        backend.run("spot_lights", planes, P)
        backend.finish()

    seconds = _times(on_device, RUNS)
    return min(seconds), float(np.median(seconds))


def _operations(source: GBuffer, lights: LightArrays) -> float:
    """Operations that the definition asks for; its reflection only where a light falls on a surface."""
    numpy = NumpyBackend()
    dark = {name: source[name] for name in source} | {"emissive": np.zeros_like(source["emissive"])}
    black = GBuffer(dark, camera=source.camera, time=source.time)
    lit = 0
    for i in range(len(lights)):
        one = LightArrays(**{name: value[i : i + 1] for name, value in vars(lights).items()})
        planes = numpy.upload(black, Scene(lights=one))
        numpy.run("spot_lights", planes, P)
        lit += int(np.count_nonzero(planes.arrays["direct"].any(axis=-1)))
    surfaces = int(np.count_nonzero(~source["sky"]))
    return surfaces * (PIXEL_OPS + len(lights) * GEOMETRY_OPS) + lit * REFLECTION_OPS


def _scene(name: str, source: GBuffer, lights: LightArrays) -> None:
    numpy = NumpyBackend()
    planes = numpy.upload(source, Scene(lights=lights))
    reference_s = float(np.median(_times(lambda: numpy.run("spot_lights", planes, P), 3)))
    truth = numpy.download64(planes, ["direct"])["direct"]
    operations = _operations(source, lights)
    print(f"{name}: {len(lights)} lights, {WIDTH}x{HEIGHT}, {operations / 1e9:.3f} G operations")
    print(f"{'numpy, float64':<40}{reference_s * 1e3:10.1f} ms")
    for report in opencl.devices():
        if not report.usable:
            print(f"{report.label}: refused ({report.problem})")
            continue
        for width in opencl.WIDTHS if report.kind == "cpu" else (1,):
            backend = OpenCLBackend(report.index, width)
            on = backend.upload(source, Scene(lights=lights))
            backend.run("spot_lights", on, P)
            largest, p9999 = error(backend.download(on, ["direct"])["direct"], truth)
            before = fma_rate(backend)
            fastest, median = _seconds(backend, on)
            limit = max(before, fma_rate(backend))
            rate = operations / fastest
            print(
                f"{report.platform[:28]:<30}x{width:<9}{fastest * 1e3:7.2f} ms ({median * 1e3:.2f} in the median)"
                f"  {reference_s / fastest:6.0f} x numpy"
                f"  {rate / 1e9:6.1f} of {limit / 1e9:.0f} GFLOP/s = {rate / limit:4.0%}"
                f"  error {largest:.1e} max, {p9999:.1e} p99.99",
                flush=True,
            )
    if find_spec("torch") is not None:
        _torch(source, lights, truth)


def _torch(source: GBuffer, lights: LightArrays, truth: Any) -> None:
    import torch

    from tests.bench.torch_lights import prepared

    torch.set_num_threads(os.cpu_count() or 1)
    function, given = prepared(source, lights)
    for name, run in (("torch eager", function), ("torch.compile", torch.compile(function))):
        with torch.no_grad():
            out = np.moveaxis(run(*given).numpy(), 0, -1)
            largest, p9999 = error(out, truth)
            seconds = _times(lambda run=run: run(*given), 10)
        print(
            f"{f'{name} {torch.__version__}, {torch.get_num_threads()} threads':<40}{min(seconds) * 1e3:7.2f} ms"
            f" ({np.median(seconds) * 1e3:.2f} in the median)  error {largest:.1e} max, {p9999:.1e} p99.99",
            flush=True,
        )


def lamps_along(source: GBuffer, count: int) -> LightArrays:
    """Street lamps on both sides of a straight road, 30 m apart, from 15 m ahead on."""
    ground = source.camera.camera_to_world[1, 3]
    lamps = [
        Light(
            kind="spot",
            position=(-6.0 if i % 2 else 6.0, ground - 7.0, 15.0 + 30.0 * (i // 2)),
            direction=(0.0, 1.0, 0.0),
            intensity=(30.0, 25.0, 18.0),
            inner_deg=30,
            outer_deg=70,
            r_max_m=20,
            frame="camera",
        )
        for i in range(count)
    ]
    return in_camera(lamps, source.camera)


def _many(source: GBuffer) -> None:
    print("street lamps along a road, both sides every 30 m, reach 20 m")
    for report in opencl.devices():
        if not report.usable:
            continue
        backend = OpenCLBackend(report.index)
        took = []
        for count in (8, 64, 512):
            took.append(_seconds(backend, backend.upload(source, Scene(lights=lamps_along(source, count))))[0])
        text = ", ".join(f"{seconds * 1e3:.2f} ms" for seconds in took)
        print(f"{report.platform[:28]:<30}x{backend.width:<3} 8, 64, 512 lamps: {text}", end="")
        print(f"; 512 take {took[2] / took[0]:.2f} times 8")


def main() -> None:
    """Measure and print."""
    whole = street.frame(28, width=WIDTH, height=HEIGHT)
    planes = {name: whole[name] for name in PASSES["spot_lights"].reads}
    source = GBuffer(planes, camera=whole.camera, time=whole.time)
    _scene("every light reaches every pixel", source, everywhere(source))
    _scene("lamps and headlights of the street", source, lights_of(source))
    _many(source)


if __name__ == "__main__":
    main()
