"""Time of every pass of some weathers on a frame of a clip, on every OpenCL device, and of more and more particles.

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
from aw4d.clip import Clip
from aw4d.pipeline import Plan, plan, prepare

RUNS = 15
WEATHERS = ("snow", "rain", "rain+night", "snow+fog")
PARTICLES = (10_000, 100_000, 1_000_000)
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
