"""Error against time of every quality: how far its pictures lie from those of `exact`, and what its passes take."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from aw4d.backend_opencl import OpenCLBackend
from aw4d.bench.timing import timed
from aw4d.clip import Clip
from aw4d.colour import srgb_codes
from aw4d.pipeline import Plan, inputs, plan, render
from aw4d.quality import QUALITIES

WEATHERS = ("snow", "rain", "fog", "overcast", "dawn", "dusk", "night", "rain+night", "snow+fog", "fog+night")
FRAMES = (5, 16, 40)
RUNS = 5
EXACT = "exact"


@dataclass(frozen=True, kw_only=True)
class Point:
    """One quality: median time of a frame's passes, and error against `exact` in 8-bit codes, of the worst frame."""

    weather: str
    clip: str
    quality: str
    ms: float
    p9999_codes: float
    max_codes: float


def points(
    backend: OpenCLBackend,
    clip: Clip,
    weather: str,
    *,
    frames: Sequence[int] = FRAMES,
    runs: int = RUNS,
    assignments: Sequence[str] = (),
) -> list[Point]:
    """Time and error of every quality on some frames of a clip."""
    exact = [_picture(backend, clip, plan(clip, weather, assignments, EXACT), index) for index in frames]
    found = []
    for quality in QUALITIES:
        made = plan(clip, weather, assignments, quality)
        off = [
            np.abs(_picture(backend, clip, made, index) - expected)
            for index, expected in zip(frames, exact, strict=True)
        ]
        took = [_milliseconds(backend, clip, made, index, runs) for index in frames]
        found.append(
            Point(
                weather=weather,
                clip=clip.info.name,
                quality=quality,
                ms=float(np.median(took)),
                p9999_codes=max(float(np.percentile(frame, 99.99)) for frame in off),
                max_codes=max(float(frame.max()) for frame in off),
            )
        )
    return found


def _picture(backend: OpenCLBackend, clip: Clip, made: Plan, index: int) -> NDArray[np.float64]:
    return srgb_codes(render(backend, clip.frame(index, made.planes), made, index)["rgb"])


def _milliseconds(backend: OpenCLBackend, clip: Clip, made: Plan, index: int, runs: int) -> float:
    """Median time of a frame's passes [ms], the frame being on the device."""
    frame, scene = inputs(clip.frame(index, made.planes), made, index)
    planes = backend.upload(frame, scene)

    def upload() -> None:
        nonlocal planes
        planes = backend.upload(frame, scene)
        backend.finish()

    def run() -> None:
        for step in made.steps:
            backend.run(step.name, planes, step.params)
        backend.finish()

    return timed(run, runs=runs, prepare=upload).median_ms


def report(console: Console, found: Sequence[Point]) -> None:
    """Print points as a table."""
    table = Table(title=f"qualities: error against {EXACT} in 8-bit codes, worst frame; time of the passes")
    for column in ("weather", "clip", "quality", "ms", "99.99th percentile", "maximum"):
        table.add_column(column, overflow="fold")
    for p in found:
        table.add_row(p.weather, p.clip, p.quality, f"{p.ms:.1f}", f"{p.p9999_codes:.2f}", f"{p.max_codes:.2f}")
    console.print(table)
