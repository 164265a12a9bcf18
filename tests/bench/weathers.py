"""Time of every pass of some weathers on a frame of a clip, on every OpenCL device, and of more and more particles.

For `reflections` also its share of what the device can do: of the time that looking up its depths takes alone, and of
the multiply-adds that the device does a second.

Run as `python -m tests.bench.weathers CLIP [FRAME [WEATHER ...]]`; `aw4d demo` makes a clip of 1280x704. Medians of
repeated runs in one process, after a warm-up.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

from aw4d import opencl
from aw4d.backend_opencl import OpenCLBackend, OpenCLPlanes
from aw4d.bench.limits import limits
from aw4d.clip import Clip
from aw4d.params import ReflectionsParams
from aw4d.pipeline import Plan, plan, prepare
from tests.bench import walk_rate

RUNS = 15
WEATHERS = ("snow", "rain", "rain+night", "snow+fog")
PARTICLES = (10_000, 100_000, 1_000_000)
# Arithmetic of a step in reference_numpy/reflections.py, a multiply-add counted as two, a division as one; clamps,
# selects and comparisons are not counted: its place and, twice, heights, widths, the lobe's share and its ramps.
STEP_OPS = 12 + 2 * 52
LIGHT = {"ambient", "overcast_sky", "night_grade", "spot_lights", "harmonize"}


def pass_times(backend: OpenCLBackend, clip: Clip, made: Plan, index: int) -> dict[str, float]:
    """Median seconds of every pass, the frame being on the device."""
    frame = prepare(clip.frame(index, made.planes), made, index)
    scene = made.scene(index)
    seen: dict[str, list[float]] = {step.name: [] for step in made.steps}
    for _ in range(RUNS + 1):
        planes: OpenCLPlanes = backend.upload(frame, scene)
        for step in made.steps:
            backend.finish()
            start = time.perf_counter()
            backend.run(step.name, planes, step.params)
            backend.finish()
            seen[step.name].append(time.perf_counter() - start)
    return {name: float(np.median(seconds[1:])) for name, seconds in seen.items()}


def _reflections_share(backend: OpenCLBackend, clip: Clip, made: Plan, index: int, took_s: float) -> None:
    """Print what all steps of all mirroring pixels would take at the device's limits, in shares of the time taken.

    The kernel need not do all that: a ray's steps end where things cover its lobe, and of the ground it needs but
    heights. Finer steps, light and surroundings come on top.
    """
    frame = prepare(clip.frame(index, made.planes), made, index)
    scene = made.scene(index)
    planes = backend.upload(frame, scene)
    for step in made.steps:
        if isinstance(step.params, ReflectionsParams):
            steps = step.params.steps
            vectors = walk_rate.mirroring(backend, planes, frame.camera, scene.world["up"], step.params)
            break
        backend.run(step.name, planes, step.params)
    looking_s = walk_rate.seconds(backend, frame.camera.shape, vectors, steps)
    arithmetic_s = len(vectors) * backend.width * steps * STEP_OPS / (1e9 * limits(backend).fma_gflop_s)
    print(
        f"    reflections: {len(vectors)} vectors of {steps} steps; their depths alone {looking_s * 1e3:.2f} ms, "
        f"{looking_s / took_s:.0%} of the time taken; their arithmetic at full rate {arithmetic_s * 1e3:.2f} ms, "
        f"{arithmetic_s / took_s:.0%}",
        flush=True,
    )


def _report(backend: OpenCLBackend, clip: Clip, weather: str, index: int) -> None:
    made = plan(clip, weather)
    took = pass_times(backend, clip, made, index)
    weather_s = sum(seconds for name, seconds in took.items() if name not in LIGHT)
    each = ", ".join(f"{name} {seconds * 1e3:.1f}" for name, seconds in took.items())
    print(
        f"  {weather}: {weather_s * 1e3:.1f} ms ({1 / weather_s:.0f} a second), with its light "
        f"{sum(took.values()) * 1e3:.1f} ms: {each}",
        flush=True,
    )
    if "reflections" in took:
        _reflections_share(backend, clip, made, index, took["reflections"])


def _particles(backend: OpenCLBackend, clip: Clip, index: int) -> None:
    for weather, name, field in (("rain", "rain_streaks", "drops"), ("snow", "snow_fall", "flakes")):
        took = []
        for count in PARTICLES:
            # so much falls that there are as many as may be
            sets = [f"{name}.{field}={count}", f"{name}.rate_mm_h=50", f"{name}.reach_m=30"]
            took.append(pass_times(backend, clip, plan(clip, weather, sets), index)[name])
        text = ", ".join(f"{count:,}: {seconds * 1e3:.1f} ms" for count, seconds in zip(PARTICLES, took, strict=True))
        print(f"  {name} {text}; the last takes {took[-1] / took[0]:.1f} times the first", flush=True)


def main(path: str, frame: str = "16", *weathers: str) -> None:
    """Measure and print."""
    clip, index = Clip(Path(path)), int(frame)
    for report in opencl.devices():
        if report.usable:
            backend = OpenCLBackend(report.index)
            print(f"{backend.name}, {clip.info.width}x{clip.info.height}, frame {index}")
            for weather in weathers or WEATHERS:
                _report(backend, clip, weather, index)
            _particles(backend, clip, index)


if __name__ == "__main__":
    main(*sys.argv[1:])
