"""What a frame costs as it grows: by pixels, by lights, by particles, and in memory by the clip's length."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from aw4d.backend_opencl import OpenCLBackend
from aw4d.bench.frames import lamps_along
from aw4d.bench.passes import PassRow
from aw4d.bench.timing import Timing, timed
from aw4d.clip import Clip
from aw4d.gbuffer import GBuffer
from aw4d.params import FogParams, Params, SpotLightsParams
from aw4d.passes import PASSES
from aw4d.pipeline import Plan, inputs, plan
from aw4d.scene import Scene

LIGHTS = (8, 64, 512)
PARTICLES = (10_000, 100_000, 1_000_000)
LENGTHS = (57, 228)  # frames
ALL = "all passes"  # their sum
FALLING = {"rain_streaks": ("rain", "drops"), "snow_fall": ("snow", "flakes")}


@dataclass(frozen=True, kw_only=True)
class CostPoint:
    """Time of a pass for so many lights or particles."""

    step: str
    device: str
    of: str
    count: int
    time: Timing


@dataclass(frozen=True, kw_only=True)
class PixelFit:
    """How far a pass' times lie from a straight line over the pixels, fixed + rate x pixels, fitted to relative errors.

    `fixed_ms` is what a frame without pixels would cost, `off` the largest deviation of a time from the line, relative.
    """

    step: str
    device: str
    fixed_ms: float
    ms_a_megapixel: float
    off: float


@dataclass(frozen=True, kw_only=True)
class MemoryPoint:
    """Peak of resident memory of an edit of so many frames, in a process of its own."""

    frames: int
    peak_mb: float


def by_pixels(rows: Sequence[PassRow]) -> list[PixelFit]:
    """Fits for every pass and device over the sizes of the street, and for the sums of all passes."""
    took: dict[tuple[str, str], dict[int, float]] = {}
    for row in rows:
        if row.bound is not None and row.scene == "street":
            took.setdefault((row.step, row.device), {})[row.width * row.height] = row.time.median_ms
    for device in dict.fromkeys(device for _, device in took):
        own = [times for (_, of), times in took.items() if of == device]
        sizes = set.intersection(*map(set, own))
        took[ALL, device] = {size: sum(times[size] for times in own) for size in sorted(sizes)}
    return [_line(step, device, times) for (step, device), times in took.items() if len(times) > 1]


def _line(step: str, device: str, times: dict[int, float]) -> PixelFit:
    """The fit of milliseconds by pixels."""
    import numpy as np

    pixels, took = np.array(list(times)) / 1e6, np.array(list(times.values()))
    lines = np.stack([1 / took, pixels / took], axis=1)
    (fixed, rate), *_ = np.linalg.lstsq(lines, np.ones(len(took)), rcond=None)
    off = float(np.abs((fixed + rate * pixels) / took - 1).max())
    return PixelFit(step=step, device=device, fixed_ms=float(fixed), ms_a_megapixel=float(rate), off=off)


def by_lights(frame: GBuffer, backend: OpenCLBackend, runs: int) -> list[CostPoint]:
    """Street lamps along a road, far beyond what the frame shows."""
    passes: dict[str, Params] = {
        "spot_lights": SpotLightsParams(),
        "fog": FogParams(visibility_m=60, color=(0.5, 0.5, 0.5)),
    }
    out = []
    for step, params in passes.items():
        planes_read = {name: frame[name] for name in PASSES[step].reads if name in frame}
        source = GBuffer(planes_read, camera=frame.camera, time=frame.time)
        for count in LIGHTS:
            planes = backend.upload(source, Scene(lights=lamps_along(frame.camera, count)))
            kept = backend.keep(planes, PASSES[step].writes)

            def run(step: str = step, params: Params = params, planes: object = planes) -> None:
                backend.run(step, planes, params)  # type: ignore[arg-type]
                backend.finish()

            took = timed(run, runs=runs, prepare=lambda planes=planes, kept=kept: backend.restore(planes, kept))  # type: ignore[misc]
            device = backend.report.platform
            out.append(CostPoint(step=step, device=device, of="lights", count=count, time=took))
    return out


def by_particles(clip: Clip, frame: GBuffer, index: int, backend: OpenCLBackend, runs: int) -> list[CostPoint]:
    """So much falls that there are as many as may be."""
    out = []
    for step, (weather, field) in FALLING.items():
        for count in PARTICLES:
            made = plan(clip, weather, [f"{step}.{field}={count}", f"{step}.rate_mm_h=50", f"{step}.reach_m=30"])
            took = _alone(made, step, frame, index, backend, runs)
            out.append(CostPoint(step=step, device=backend.report.platform, of="particles", count=count, time=took))
    return out


def _alone(made: Plan, name: str, frame: GBuffer, index: int, backend: OpenCLBackend, runs: int) -> Timing:
    """Time of one pass of a plan on the frame as it was recorded."""
    planes = backend.upload(*inputs(frame, made, index))
    (params,) = (step.params for step in made.steps if step.name == name)
    kept = backend.keep(planes, PASSES[name].writes)

    def run() -> None:
        backend.run(name, planes, params)
        backend.finish()

    return timed(run, runs=runs, prepare=lambda: backend.restore(planes, kept))


_EDIT = """
import sys
from pathlib import Path
from aw4d.clip import Clip
from aw4d.output import write_edit
from aw4d.pipeline import plan
from aw4d.render import open_backend
clip, out, count = Clip(Path(sys.argv[1])), Path(sys.argv[2]), int(sys.argv[3])
write_edit(clip, plan(clip, "fog"), open_backend("opencl"), [i % len(clip) for i in range(count)], out)
# Not ru_maxrss: a process that was forked has its parent's peak there.
print(next(int(line.split()[1]) for line in open("/proc/self/status") if line.startswith("VmHWM")) / 1024)
"""


def by_length(clip: Clip, folder: Path, lengths: Sequence[int] = LENGTHS) -> list[MemoryPoint]:
    """Peak memory of edits of so many frames, those of the clip over and over."""
    out = []
    for frames in lengths:
        command = [sys.executable, "-c", _EDIT, str(clip.path), str(folder / f"{frames}.mp4"), str(frames)]
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        out.append(MemoryPoint(frames=frames, peak_mb=float(done.stdout.split()[-1])))
    return out
