"""Speed against error: every knob of a pass as points (time, error), and which of them lie on the front.

A point is off the front where another one is at once faster and less wrong. Errors are those of the pass' `rgb` against
the same pass in its finest setting: fog's in float64, the others' on the device, whose own error is far smaller.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from aw4d.backend_numpy import NumpyBackend
from aw4d.backend_opencl import OpenCLBackend
from aw4d.bench.frames import for_camera
from aw4d.bench.passes import MEASURED, Case
from aw4d.bench.timing import Timing, timed
from aw4d.camera import Camera
from aw4d.clip import Clip
from aw4d.colour import encode_srgb8
from aw4d.compare import error
from aw4d.gbuffer import GBuffer
from aw4d.params import AmbientParams, FogParams, ReflectionsParams
from aw4d.passes import PASSES
from aw4d.pipeline import Plan, inputs, plan, prepare


@dataclass(frozen=True, kw_only=True)
class Point:
    """One setting: its time on the device, its relative errors, and its mean error in 8-bit sRGB codes."""

    knob: str
    setting: str
    step: str
    time: Timing
    max_error: float
    p9999_error: float
    mean_codes: float
    default: bool
    on_front: bool = False


@dataclass(frozen=True, kw_only=True)
class HalfRow:
    """What float16 planes would do to a pass: its errors against itself where all that it reads was rounded first."""

    step: str
    max_error: float
    p9999_error: float


@dataclass(frozen=True, kw_only=True)
class Knob:
    """What is turned: a weather in which the pass runs, assignments for every setting, and for the finest one."""

    name: str
    step: str
    weather: str
    settings: dict[str, tuple[str, ...]]
    finest: tuple[str, ...]
    default: str = ""
    exact: bool = False  # whether the finest is computed in float64


def _each(field: str, values: Sequence[object]) -> dict[str, tuple[str, ...]]:
    return {str(value): (f"{field}={value}",) for value in values}


_OCCLUSION = ((1, 3), (2, 4), (2, 7), (4, 7), (8, 9))
KNOBS = (
    Knob(
        name="fog nodes",
        step="fog",
        weather="fog",
        settings={k: (*v, "fog.faintest=0") for k, v in _each("fog.nodes", (2, 4, 8, 16, 32)).items()},
        finest=("fog.nodes=64", "fog.faintest=0"),
        default=str(FogParams().nodes),
        exact=True,
    ),
    Knob(
        name="faintest glow",
        step="fog",
        weather="snow",
        settings=_each("fog.faintest", ("0", "3e-05", "0.0003", "0.003", "0.03")),
        finest=("fog.nodes=64", "fog.faintest=0"),
        default=str(FogParams().faintest),
        exact=True,
    ),
    Knob(
        name="shadow steps",
        step="ambient",
        weather="dawn",
        settings={
            k: (*v, "ambient.preset=golden_hour", "ambient.sun_altitude_deg=15")
            for k, v in _each("ambient.shadow_steps", (10, 20, 40, 80, 160, 320)).items()
        },
        finest=("ambient.shadow_steps=1024", "ambient.preset=golden_hour", "ambient.sun_altitude_deg=15"),
        default=str(AmbientParams().shadow_steps),
    ),
    Knob(
        name="occlusion slices x steps",
        step="ambient",
        weather="overcast",
        settings={
            f"{slices}x{steps}": (f"ambient.occlusion_slices={slices}", f"ambient.occlusion_steps={steps}")
            for slices, steps in _OCCLUSION[:-1]
        },
        finest=("ambient.occlusion_slices=8", "ambient.occlusion_steps=9"),
        default="4x7",
    ),
    Knob(
        name="reflection steps",
        step="reflections",
        weather="rain",
        settings=_each("reflections.steps", (7, 14, 28, 56, 112)),
        finest=("reflections.steps=256",),
        default=str(ReflectionsParams().steps),
    ),
)


def front(points: Sequence[tuple[float, float]]) -> list[bool]:
    """Which points (time, error) lie on the Pareto front: no other is as fast and as exact, and better in one."""
    return [not any(t <= time and e <= wrong and (t, e) != (time, wrong) for t, e in points) for time, wrong in points]


def turn(knob: Knob, clip: Clip, frame: GBuffer, index: int, backend: OpenCLBackend, runs: int) -> list[Point]:
    """Measure all settings of a knob on a frame of a clip."""
    truth = _finest(knob, clip, frame, index, backend)
    points = []
    for setting, sets in knob.settings.items():
        values, took = _run(plan(clip, knob.weather, sets), knob.step, frame, index, backend, runs)
        points.append(_point(knob.name, setting, knob.step, took, values, truth, default=setting == knob.default))
    return marked(points)


def marked(points: Sequence[Point]) -> list[Point]:
    """The points with those on the front told, by the 99.99th percentile of the error and by its mean."""
    exact = front([(p.time.median_ms, p.p9999_error) for p in points])
    mean = front([(p.time.median_ms, p.mean_codes) for p in points])
    return [dataclasses.replace(p, on_front=a or b) for p, a, b in zip(points, exact, mean, strict=True)]


def _point(
    knob: str, setting: str, step: str, took: Timing, values: NDArray[Any], truth: NDArray[Any], *, default: bool
) -> Point:
    largest, p9999 = error(values, truth)
    codes = np.abs(encode_srgb8(values).astype(np.float32) - encode_srgb8(truth.astype(np.float32)))
    return Point(
        knob=knob,
        setting=setting,
        step=step,
        time=took,
        max_error=largest,
        p9999_error=p9999,
        mean_codes=float(codes.mean()),
        default=default,
    )


def _before(made: Plan, step: str) -> list[Any]:
    names = [one.name for one in made.steps]
    return list(made.steps[: names.index(step)])


def _finest(knob: Knob, clip: Clip, frame: GBuffer, index: int, backend: OpenCLBackend) -> NDArray[Any]:
    made = plan(clip, knob.weather, knob.finest)
    if not knob.exact:
        return _run(made, knob.step, frame, index, backend, 1)[0].astype(np.float64)
    source = prepare(frame, made, index)
    planes = backend.upload(source, made.scene(index))
    before, numpy = _before(made, knob.step), NumpyBackend()
    for step in before:
        backend.run(step.name, planes, step.params)
    edited = {plane for step in before for plane in PASSES[step.name].writes}
    truth = numpy.upload(source, made.scene(index))
    for name, values in backend.download(planes, [n for n in PASSES[knob.step].reads if n in edited]).items():
        numpy.put(truth, name, values)
    step = made.steps[len(before)]
    numpy.run(step.name, truth, step.params)
    return truth.arrays["rgb"]


def _run(
    made: Plan, name: str, frame: GBuffer, index: int, backend: OpenCLBackend, runs: int
) -> tuple[NDArray[Any], Timing]:
    """The pass' picture and its time, after all that comes before it."""
    planes = backend.upload(*inputs(frame, made, index))
    before = _before(made, name)
    for step in before:
        backend.run(step.name, planes, step.params)
    step = made.steps[len(before)]
    kept = backend.keep(planes, PASSES[name].writes)

    def run() -> None:
        backend.run(step.name, planes, step.params)
        backend.finish()

    took = timed(run, runs=runs, prepare=lambda: backend.restore(planes, kept))
    return backend.download(planes, ["rgb"])["rgb"], took


def half_resolution(clip: Clip, frame: GBuffer, index: int, backend: OpenCLBackend, runs: int) -> list[Point]:
    """`ambient` on every second pixel of every second row, against all of them.

    Its light, radiance over albedo, is enlarged bilinearly and put on the albedo; that is not timed: the time is the
    least that it can be.
    """
    made = plan(clip, "overcast")
    truth, whole = _run(made, "ambient", frame, index, backend, runs)
    small = _halved(frame)
    values, took = _run(for_camera(made, small.camera), "ambient", small, index, backend, runs)
    light = values / np.maximum(small["albedo"], 1e-3)
    wide = cv2.resize(light, truth.shape[1::-1], interpolation=cv2.INTER_LINEAR) * np.maximum(frame["albedo"], 1e-3)
    wide = np.where(frame["sky"][..., None], truth, wide).astype(np.float32)
    exact = truth.astype(np.float64)
    knob = "resolution of ambient"
    return marked(
        [
            _point(knob, "1", "ambient", whole, truth, exact, default=True),
            _point(knob, "1/2", "ambient", took, wide, exact, default=False),
        ]
    )


def _halved(frame: GBuffer) -> GBuffer:
    camera = frame.camera
    height, width = camera.height // 2, camera.width // 2
    K = camera.K.copy()
    K[:2] /= 2
    planes = {name: np.ascontiguousarray(frame[name][: 2 * height : 2, : 2 * width : 2]) for name in frame}
    half = Camera(width=width, height=height, K=K, camera_to_world=camera.camera_to_world)
    return GBuffer(planes, camera=half, time=frame.time)


def half_planes(case: Case, backend: OpenCLBackend) -> list[HalfRow]:
    """What float16 planes would do to the passes; no pass reads them, so that there is no time."""
    frame, scene = inputs(case.frame, case.made, case.index)
    out = []
    planes = backend.upload(frame, scene)
    for step in case.made.steps:
        entry = PASSES[step.name]
        floats = [n for n in entry.reads if n in planes.buffers and n not in ("sky", "road", "vehicle", "street_light")]
        held = backend.download(planes, floats)
        kept = backend.keep(planes, [*floats, *entry.writes])
        backend.run(step.name, planes, step.params)
        exact = backend.download(planes, entry.writes)
        after = backend.keep(planes, entry.writes)
        if step.name in MEASURED[case.made.weather]:
            backend.restore(planes, kept)
            for name, values in held.items():
                backend.put(planes, name, values.astype(np.float16).astype(np.float32))
            backend.run(step.name, planes, step.params)
            found = backend.download(planes, entry.writes)
            each = [error(found[name], exact[name], vectors=name == "normal") for name in entry.writes]
            largest, p9999 = (max(one[i] for one in each) for i in (0, 1))
            out.append(HalfRow(step=step.name, max_error=largest, p9999_error=p9999))
            backend.restore(planes, kept)
        backend.restore(planes, after)
    return out
