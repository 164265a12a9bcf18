"""Peers of the same arithmetic beside the devices: the same planes, the same threads, the same run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aw4d.backend_opencl import OpenCLBackend
from aw4d.bench.frames import eight_everywhere, eight_of_the_street
from aw4d.bench.left_out import LeftOut
from aw4d.bench.passes import NUMPY
from aw4d.bench.peers.given import PEERED, Given, given
from aw4d.bench.timing import Timing, seconds, timed, timing
from aw4d.colour import encode_srgb8
from aw4d.compare import error
from aw4d.gbuffer import GBuffer
from aw4d.params import FogParams, HarmonizeParams, OvercastSkyParams, Params, SpotLightsParams, WetGroundParams
from aw4d.passes import PASSES
from aw4d.scene import Scene

TORCH, COMPILED, NUMBA, ALBUMENTATIONS = "torch eager", "torch.compile", "numba parallel", "albumentations"
PARAMS: dict[str, Params] = {
    "spot_lights": SpotLightsParams(),
    "fog": FogParams(visibility_m=60, nodes=8, color=(0.5, 0.5, 0.5)),
    "harmonize": HarmonizeParams(),
    "overcast_sky": OvercastSkyParams(),
    "wet_ground": WetGroundParams(wetness=0.8),
}


@dataclass(frozen=True, kw_only=True)
class PeerRow:
    """One pass by one peer or device; `ratio` is its time over that of the fastest device. Errors are of float64."""

    step: str
    scene: str
    peer: str
    time: Timing
    ratio: float
    max_error: float | None
    p9999_error: float | None

    @property
    def is_device(self) -> bool:
        """Whether it is an OpenCL device, and no peer."""
        return self.peer not in (NUMPY, TORCH, COMPILED, NUMBA, ALBUMENTATIONS)


def scenes(frame: GBuffer) -> dict[str, Scene]:
    """Eight lights of the street, most of them out of the reach of most pixels, and eight that reach every pixel."""
    camera = frame.camera
    up = (np.linalg.inv(camera.camera_to_world[:3, :3]) @ (0.0, 1.0, 0.0)).astype(np.float32)
    chosen = {"street": eight_of_the_street(camera), "everywhere": eight_everywhere(camera)}
    return {name: Scene(lights=lights, world={"up": up}) for name, lights in chosen.items()}


def measure(
    frame: GBuffer, backends: Sequence[OpenCLBackend], runs: int, absent: Sequence[str] = ()
) -> tuple[list[PeerRow], list[LeftOut]]:
    """Time every pass that has peers by all of them; `absent` names packages that count as not installed.

    The passes without lights are measured once.
    """
    rows: list[PeerRow] = []
    missing = [name for name in ("torch", "numba") if name in absent or find_spec(name) is None]
    for name, scene in scenes(frame).items():
        for step in PEERED:
            if name == "street" or step in ("spot_lights", "fog"):
                rows += _of_pass(name, _given(step, frame, scene), backends, runs, missing)
    names = {"torch": f"{TORCH}, {COMPILED}", "numba": NUMBA}
    return rows, [LeftOut(what=names[name], why=f"{name} is not installed") for name in missing]


def _given(step: str, frame: GBuffer, scene: Scene) -> Given:
    """The pass on the planes that it reads; some picture stands for the lamps' light."""
    planes = {name: frame[name] for name in PASSES[step].reads if name in frame}
    source = GBuffer(planes, camera=frame.camera, time=frame.time)
    made = given(step, source, scene, PARAMS[step])
    if step == "harmonize":
        made.planes["direct"] = np.ascontiguousarray(0.3 * made.planes["rgb"][::-1])
    return made


def _of_pass(
    scene: str, held: Given, backends: Sequence[OpenCLBackend], runs: int, missing: Sequence[str]
) -> list[PeerRow]:
    numpy, planes = held.reference()
    if held.step == "harmonize":
        numpy.put(planes, "direct", np.moveaxis(held.planes["direct"], 0, -1))
    before = dict(planes.arrays)
    run_numpy = _timed_numpy(lambda: numpy.run(held.step, planes, held.params), lambda: planes.arrays.update(before))
    truth = planes.arrays[held.result]
    found: dict[str, tuple[Timing, NDArray[Any]]] = {}
    for backend in backends:
        found[backend.report.platform] = _on_device(held, backend, runs)
    devices = list(found)
    for name, call in calls(held, missing).items():
        value = np.moveaxis(call(), 0, -1).copy()
        found[name] = timed(call, runs=runs, prepare=_written_anew(held)), value
    fastest = min(found[name][0].median_ms for name in devices)
    rows = [_row(held, scene, NUMPY, run_numpy, fastest, (0.0, 0.0))]
    for name, (took, value) in found.items():
        rows.append(_row(held, scene, name, took, fastest, error(value, truth)))
    return rows


def _row(
    held: Given, scene: str, peer: str, took: Timing, fastest: float, errors: tuple[float | None, float | None]
) -> PeerRow:
    return PeerRow(
        step=held.step,
        scene=scene,
        peer=peer,
        time=took,
        ratio=took.median_ms / fastest,
        max_error=errors[0],
        p9999_error=errors[1],
    )


def _written_anew(held: Given) -> Callable[[], None]:
    """Bring the planes that a pass edits back before a run, as a device's are: caches hold the same for all."""
    kept = {name: held.planes[name].copy() for name in PASSES[held.step].writes if name in held.planes}

    def write() -> None:
        for name, values in kept.items():
            np.copyto(held.planes[name], values)

    return write


def _timed_numpy(run: Callable[[], object], prepare: Callable[[], object]) -> Timing:
    """Of one run where that takes long, else of a few."""
    (first,) = seconds(run, 1, prepare)
    return timing([first]) if first > 0.5 else timed(run, runs=3, prepare=prepare)


def _on_device(held: Given, backend: OpenCLBackend, runs: int) -> tuple[Timing, NDArray[Any]]:
    planes = backend.upload(held.frame, held.scene)
    if held.step == "harmonize":
        backend.put(planes, "direct", np.moveaxis(held.planes["direct"], 0, -1))
    kept = backend.keep(planes, PASSES[held.step].writes)

    def run() -> None:
        backend.run(held.step, planes, held.params)
        backend.finish()

    run()
    value = backend.download(planes, [held.result])[held.result]
    return timed(run, runs=runs, prepare=lambda: backend.restore(planes, kept)), value


def calls(held: Given, missing: Sequence[str]) -> dict[str, Callable[[], Any]]:
    """Every peer that is installed, by its name."""
    out: dict[str, Callable[[], Any]] = {}
    if "torch" not in missing:
        from aw4d.bench.peers import torch_passes

        out[TORCH] = torch_passes.prepared(held, compiled=False)
        out[COMPILED] = torch_passes.prepared(held, compiled=True)
    if "numba" not in missing:
        from aw4d.bench.peers import numba_passes

        out[NUMBA] = numba_passes.prepared(held)
    return out


def today(frame: GBuffer, runs: int, absent: Sequence[str] = ()) -> tuple[list[PeerRow], list[LeftOut]]:
    """What people use today, for its time alone; its pictures are another thing, and have no error."""
    if ALBUMENTATIONS in absent or find_spec(ALBUMENTATIONS) is None:
        return [], [LeftOut(what=ALBUMENTATIONS, why=f"{ALBUMENTATIONS} is not installed")]
    from aw4d.bench.peers import today as painted

    picture = encode_srgb8(frame["rgb"])
    rows = []
    for name in painted.NAMES:
        took = timed(painted.prepared(name, picture), runs=runs)
        rows.append(
            PeerRow(
                step=name,
                scene="street",
                peer=ALBUMENTATIONS,
                time=took,
                ratio=1.0,
                max_error=None,
                p9999_error=None,
            )
        )
    return rows, []
