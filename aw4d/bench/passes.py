"""Every pass on every backend: time, work, share of the limit that binds, and error against float64."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Sequence
from dataclasses import dataclass, field

from aw4d.backend_numpy import NumpyBackend, NumpyPlanes
from aw4d.backend_opencl import OpenCLBackend, OpenCLPlanes
from aw4d.bench.counting import moved_bytes, operations
from aw4d.bench.left_out import LeftOut
from aw4d.bench.limits import Limits
from aw4d.bench.timing import Timing, timed, timing
from aw4d.compare import VECTORS, error
from aw4d.gbuffer import GBuffer
from aw4d.passes import PASSES
from aw4d.pipeline import Plan, Step, inputs

NUMPY = "numpy"
# The weather in which each pass is measured: together they run all.
MEASURED = {
    "snow": ("snow_cover", "overcast_sky", "snow_fall"),
    "rain+night": (
        *("wet_ground", "puddles", "ripples", "ambient", "night_grade"),
        *("spot_lights", "harmonize", "reflections", "fog", "rain_streaks"),
    ),
}


@dataclass(frozen=True, kw_only=True)
class PassRow:
    """One pass on one frame and one backend.

    `bound` is the limit that says the least time, `share` that time over the median; both are None on NumPy. Errors are
    those of the worst plane that the pass writes; None where the reference was left out.
    """

    step: str
    scene: str
    width: int
    height: int
    device: str
    time: Timing
    bytes: int
    operations: float
    bound: str | None = None
    share: float | None = None
    max_error: float | None = None
    p9999_error: float | None = None


@dataclass(kw_only=True)
class Reference:
    """When the NumPy backend runs: while a run is short and there is time left; what it took, and what was counted.

    Both grow with the pixels, so that one frame tells of the next.
    """

    left_s: float
    longest_s: float
    seconds_a_pixel: dict[tuple[str, str], float] = field(default_factory=dict)
    operations_a_pixel: dict[tuple[str, str], float] = field(default_factory=dict)

    def expected_s(self, step: str, scene: str, pixels: int) -> float:
        """What a run will take, as far as an earlier one told."""
        return self.seconds_a_pixel.get((step, scene), 0.0) * pixels

    def refuses(self, step: str, scene: str, pixels: int) -> str:
        """Why a run is left out; empty where it is not."""
        needed = self.expected_s(step, scene, pixels)
        if needed > self.longest_s:
            return f"would take {needed:.0f} s, more than the {self.longest_s:.0f} s that a run may"
        return "" if needed <= self.left_s else f"would take {needed:.0f} s, and {max(self.left_s, 0):.0f} s are left"


@dataclass(frozen=True, kw_only=True)
class Case:
    """A frame, what it is called, and what runs on it."""

    scene: str
    frame: GBuffer
    index: int
    made: Plan

    @property
    def pixels(self) -> int:
        """Of the frame."""
        return self.frame.camera.width * self.frame.camera.height


def measure(
    case: Case, backends: Sequence[OpenCLBackend], limits: Sequence[Limits], reference: Reference, runs: int
) -> tuple[list[PassRow], list[LeftOut]]:
    """Time the passes of the case's weather that are measured in it, each on the same planes on every backend.

    What NumPy gives, rounded, is what the next pass starts from; where NumPy is left out, what the first device gives.
    """
    frame, scene = inputs(case.frame, case.made, case.index)
    truth = NumpyBackend().upload(frame, scene)
    tried = [backend.upload(frame, scene) for backend in backends]
    rows: list[PassRow] = []
    left_out: list[LeftOut] = []
    for step in case.made.steps:
        listed = step.name in MEASURED[case.made.weather]
        why = reference.refuses(step.name, case.scene, case.pixels)
        work = _work(case, step, truth, reference)
        if not why:
            rows += [_on_numpy(case, step, truth, work, reference)] * listed
        elif listed:
            left_out.append(LeftOut(what=f"{NUMPY}: {step.name}, {case.scene}, {_size(case)}", why=why))
        for backend, limit, planes in zip(backends, limits, tried, strict=True):
            rows += _on_device(case, step, backend, planes, work, limit, None if why else truth, runs if listed else 0)
        _agree(step, truth, backends, tried, exact=not why)
    return rows, left_out


def with_limits(row: PassRow, limits: Sequence[Limits]) -> PassRow:
    """The row by limits that were measured better since."""
    for limit in limits:
        if limit.device == row.device:
            least_s, bound = limit.seconds(row.operations, row.bytes)
            return dataclasses.replace(row, bound=bound, share=least_s * 1e3 / row.time.median_ms)
    return row


def _size(case: Case) -> str:
    return f"{case.frame.camera.width}x{case.frame.camera.height}"


def _work(case: Case, step: Step, truth: NumpyPlanes, reference: Reference) -> tuple[int, float]:
    """Bytes, and operations: counted on the first frame of a scene, then by the pixel."""
    key = (step.name, case.scene)
    if key not in reference.operations_a_pixel:
        start = time.perf_counter()
        reference.operations_a_pixel[key] = operations(step.name, truth, step.params) / case.pixels
        reference.left_s -= time.perf_counter() - start
    return moved_bytes(step.name, truth.shape, truth.arrays.keys()), reference.operations_a_pixel[key] * case.pixels


def _row(case: Case, step: Step, device: str, took: Timing, work: tuple[int, float]) -> dict[str, object]:
    """What a row has on every backend."""
    camera = case.frame.camera
    return {
        "step": step.name,
        "scene": case.scene,
        "width": camera.width,
        "height": camera.height,
        "device": device,
        "time": took,
        "bytes": work[0],
        "operations": work[1],
    }


def _on_numpy(case: Case, step: Step, truth: NumpyPlanes, work: tuple[int, float], reference: Reference) -> PassRow:
    """One run, which is the reference, too; its own rounding is its error."""
    start = time.perf_counter()
    NumpyBackend().run(step.name, truth, step.params)
    took_s = time.perf_counter() - start
    reference.left_s -= took_s
    reference.seconds_a_pixel[step.name, case.scene] = took_s / case.pixels
    return PassRow(**_row(case, step, NUMPY, timing([took_s]), work), max_error=0.0, p9999_error=0.0)  # type: ignore[arg-type]


def _on_device(
    case: Case,
    step: Step,
    backend: OpenCLBackend,
    planes: OpenCLPlanes,
    work: tuple[int, float],
    limit: Limits,
    truth: NumpyPlanes | None,
    runs: int,
) -> list[PassRow]:
    """The pass is run once, and its error taken; then it is timed, from the same planes each time."""
    writes = PASSES[step.name].writes
    kept = backend.keep(planes, writes) if runs else {}

    def run() -> None:
        backend.run(step.name, planes, step.params)
        backend.finish()

    run()
    if not runs:
        return []
    errors: tuple[float | None, float | None] = (None, None)
    if truth is not None:
        found = backend.download(planes, writes)
        each = [error(found[name], truth.arrays[name], vectors=name in VECTORS) for name in writes]
        errors = max(one[0] for one in each), max(one[1] for one in each)
    took = timed(run, runs=runs, prepare=lambda: backend.restore(planes, kept))
    numbers = _row(case, step, backend.report.platform, took, work)
    row = PassRow(**numbers, max_error=errors[0], p9999_error=errors[1])  # type: ignore[arg-type]
    return [with_limits(row, [limit])]


def _agree(
    step: Step, truth: NumpyPlanes, backends: Sequence[OpenCLBackend], tried: Sequence[OpenCLPlanes], *, exact: bool
) -> None:
    """Give every backend the same float32 planes: the reference's, or the first device's."""
    writes = PASSES[step.name].writes
    same = NumpyBackend().download(truth, writes) if exact else backends[0].download(tried[0], writes)
    for name, values in same.items():
        NumpyBackend().put(truth, name, values)
        for backend, planes in zip(backends, tried, strict=True):
            backend.put(planes, name, values)
