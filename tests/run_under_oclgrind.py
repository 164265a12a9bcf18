"""Kernels on odd frames at every width, for `oclgrind python -m tests.run_under_oclgrind`; faulty ones as a control."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

from aw4d import opencl
from aw4d.backend_opencl import OpenCLBackend
from aw4d.environment import arrays, environment
from aw4d.lights.light import in_camera
from aw4d.params import (
    AmbientParams,
    FogParams,
    RainStreaksParams,
    ReflectionsParams,
    SnowCoverParams,
    SpotLightsParams,
)
from aw4d.passes import PASSES
from aw4d.scene import Scene
from aw4d.world import anchor
from tests import cover_inputs, falling_inputs, grade_inputs, ground_inputs, lit_inputs
from tests.fog_inputs import all_kinds, frame, on, street_lamps

SIZES = ((37, 13), (16, 2), (1, 1))  # width, height [px]
FAULTY = """
__kernel void beyond(__global const float *a, __global float *out)
{
    const int i = get_global_id(0);
    out[i] = a[i + 1];
}
__kernel void unset(__global const float *a, __global float *out)
{
    float values[4];
    const int i = get_global_id(0);
    if (values[i % 4] > 0.0f)
        out[i] = a[i];
}
__kernel void race(__global const float *a, __global float *out)
{
    out[0] = a[get_global_id(0)] + get_global_id(0);
}
"""


def simulator() -> opencl.DeviceReport:
    """Oclgrind's device, which must be the only one."""
    (report,) = opencl.devices()
    if report.platform != "Oclgrind" or not report.usable:
        raise SystemExit(f"expected Oclgrind's simulator, got {report.label}: {report.problem or 'it works'}")
    return report


def fog(convention: str) -> None:
    """The fog kernel with and without layers, under every kind of light, at every width and some odd sizes."""
    p = FogParams(color=(0.5, 0.55, 0.6), convention=convention)
    for width in opencl.WIDTHS:
        backend = OpenCLBackend(simulator().index, width)
        for columns, rows in SIZES:
            source, lights = frame(columns, rows), [*all_kinds(), *street_lamps(2)]
            for name, values in on(backend, source, lights, p).items():
                assert np.isfinite(values).all(), name
            _without_layers(backend, source, p)


def _without_layers(backend: OpenCLBackend, source: Any, p: FogParams) -> None:
    planes = backend.upload(source, Scene(lights=in_camera([], source.camera)))
    backend.run("fog", planes, p)
    assert np.isfinite(backend.download(planes, ["rgb"])["rgb"]).all()


def grade(name: str) -> None:
    """A pass that looks at no geometry, in both conventions, with layers and without, at every width and odd sizes."""
    for width in opencl.WIDTHS:
        backend = OpenCLBackend(simulator().index, width)
        for columns, rows in SIZES:
            source = grade_inputs.frame(columns, rows)
            working = {"direct": source["rgb"]} if "direct" in PASSES[name].reads else {}
            for convention, layers in (("physical", True), ("paper", False)):
                p = PASSES[name].params(convention=convention)
                for key, values in grade_inputs.on(backend, name, source, p, layers=layers, **working).items():
                    assert np.isfinite(values).all(), key


def spot_lights(convention: str) -> None:
    """Local lights under every kind of light and none, more than a word of bits holds, at every width and odd sizes."""
    p = SpotLightsParams(convention=convention)
    for width in opencl.WIDTHS:
        backend = OpenCLBackend(simulator().index, width)
        for columns, rows in SIZES:
            source = lit_inputs.frame(columns, rows)
            for lights in ([*all_kinds(), *street_lamps(40)], []):  # the most first: see `falling`
                assert np.isfinite(lit_inputs.on(backend, source, lights, p)).all()


def ambient(preset: str) -> None:
    """Light of the surroundings, with layers and without, at every width and odd sizes."""
    p = AmbientParams(preset=preset, shadow_steps=12)  # type: ignore[arg-type]
    around = environment(p)
    for width in opencl.WIDTHS:
        backend = OpenCLBackend(simulator().index, width)
        for columns, rows in SIZES:
            source = lit_inputs.frame(columns, rows, rgb=np.zeros((rows, columns, 3), np.float32))
            tables = arrays(around, source.camera, 1_000.0).arguments()
            scene = Scene(lights=in_camera([], source.camera), environment=tables)
            for layers in ((), PASSES["ambient"].layers):
                planes = backend.upload(source, scene, [*layers])
                backend.run("ambient", planes, p)
                for name, values in backend.download(planes, ["rgb", *layers]).items():
                    assert np.isfinite(values).all(), name


def snow_cover(convention: str) -> None:
    """Snow that lies, with layers and without, between vehicles and ruts, at every width and odd sizes."""
    p = SnowCoverParams(convention=convention, displacement=True)  # type: ignore[arg-type]
    for width in opencl.WIDTHS:
        backend = OpenCLBackend(simulator().index, width)
        for columns, rows in SIZES:
            source = cover_inputs.frame(columns, rows)
            held = cover_inputs.scene(cover_inputs.driving(source=source), 0, p)
            for layers in (True, False):
                for name, values in cover_inputs.on(backend, source, held, p, layers=layers).items():
                    assert np.isfinite(values).all(), name


def ground(name: str) -> None:
    """Water on the ground, in both conventions, with layers and without, at every width and odd sizes."""
    for width in opencl.WIDTHS:
        backend = OpenCLBackend(simulator().index, width)
        for columns, rows in SIZES:
            source = ground_inputs.frame(columns, rows)
            water = np.where(source["road"], 0.7, 0).astype(np.float32)
            working = {"puddle": water} if "puddle" in PASSES[name].reads else {}
            if "snow_bare" in PASSES[name].reads:  # Oclgrind 21.10 takes what the backend fills in for unset
                working["snow_bare"] = np.ones((rows, columns), np.float32)
            for convention, layers in (("physical", True), ("paper", False)):
                p = PASSES[name].params(convention=convention)
                for key, values in ground_inputs.run(backend, name, source, p, layers=layers, **working).items():
                    assert np.isfinite(values).all(), key


def falling(name: str) -> None:
    """What falls, in both conventions, with layers and without, none and more than a word holds, at every width."""
    amount = "drops" if name == "rain_streaks" else "flakes"
    for width in opencl.WIDTHS:
        backend = OpenCLBackend(simulator().index, width)
        for columns, rows in SIZES:
            info = falling_inputs.clip(columns, rows)
            source = falling_inputs.frame(info)
            # The most first: Oclgrind 21.10 takes what a larger buffer has in place of a smaller one for unset.
            for convention, layers, count in (("paper", False, 300), ("physical", True, 90), ("physical", False, 0)):
                p = PASSES[name].params(convention=convention, **{amount: count})
                where = falling_inputs.scene(info, p, lights=all_kinds())
                for key, values in falling_inputs.on(backend, source, where, p, layers=layers).items():
                    assert np.isfinite(values).all(), key


def one_tile(count: str) -> None:
    """So many drops in one tile, all but those right at the lens; a wall behind the nearest twentieth.

    Of every drop the simulator keeps some 15 kB until the last one is drawn. The rain is so heavy, and seen so far,
    that there are as many drops as may be.
    """
    backend = OpenCLBackend(simulator().index, 16)
    info, p = (
        falling_inputs.clip(16, 2),
        RainStreaksParams(drops=int(count), rate_mm_h=300.0, near_m=0.01, reach_m=15.0),
    )
    wall = {"depth": np.full((2, 16), 0.45, np.float32), "sky": np.zeros((2, 16), bool)}
    where = falling_inputs.in_one_tile(falling_inputs.scene(info, p), p)
    for name, values in falling_inputs.on(backend, falling_inputs.frame(info, **wall), where, p).items():
        assert np.isfinite(values).all(), name
    shown = np.empty(1, dtype=np.int32)
    backend._cl.enqueue_copy(backend._queue, shown, backend._pool["particle_shown"])
    assert shown[0] > 0.99 * int(count)


def reflections(case: str) -> None:
    """Wet ground, with the layer and without, at every width and odd sizes."""
    around = environment(AmbientParams())
    p = ReflectionsParams(steps=6)
    for width in opencl.WIDTHS:
        backend = OpenCLBackend(simulator().index, width)
        for columns, rows in SIZES:
            source = lit_inputs.frame(columns, rows, rgb=np.ones((rows, columns, 3), np.float32))
            normal = np.broadcast_to(np.float32([0, -1, 0]), (rows, columns, 3))
            source = source.with_plane("normal", np.ascontiguousarray(normal))
            tables = arrays(around, source.camera, 1_000.0).arguments()
            world = anchor(source.camera, 0.0)
            scene = Scene(lights=in_camera([], source.camera), environment=tables, world=world)
            for layers in ((), PASSES["reflections"].layers):
                planes = backend.upload(source, scene, [*layers])
                ones = np.full((rows, planes.pitch), float(case == "wet"), np.float32)
                for name in ("puddle", "wetness", "occlusion"):
                    planes.buffers[name] = backend._to_device(name, ones)
                backend.run("reflections", planes, p)
                for name, values in backend.download(planes, ["rgb", *layers]).items():
                    assert np.isfinite(values).all(), name


def show(name: str) -> None:
    """The 8-bit picture at every width and odd sizes."""
    for width in opencl.WIDTHS:
        backend = OpenCLBackend(simulator().index, width)
        for columns, rows in SIZES:
            source = grade_inputs.frame(columns, rows)
            planes = backend.upload(source, Scene(lights=in_camera([], source.camera)))
            assert backend.download(planes, [name])[name].shape == (rows, columns, 3)


def faulty(name: str) -> None:
    """A kernel with a fault, which must be reported."""
    cl = opencl.load()
    context = cl.Context([simulator().device])
    queue = cl.CommandQueue(context)
    kernel = cl.Kernel(cl.Program(context, FAULTY).build(cache_dir=False), name)
    ones = np.ones(16, dtype=np.float32)
    a, out = (cl.Buffer(context, cl.mem_flags.COPY_HOST_PTR, hostbuf=ones) for _ in range(2))
    kernel(queue, ones.shape, None, a, out)
    queue.finish()


if __name__ == "__main__":
    known = {
        "fog": fog,
        "grade": grade,
        "spot_lights": spot_lights,
        "ambient": ambient,
        "snow_cover": snow_cover,
        "ground": ground,
        "falling": falling,
        "one_tile": one_tile,
        "show": show,
        "faulty": faulty,
        "reflections": reflections,
    }
    run, case = known[sys.argv[1]], sys.argv[2]
    run(case)
