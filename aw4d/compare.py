"""The same frames on every backend and device: how far each lies from the float64 reference."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from aw4d import opencl
from aw4d.backend_numpy import NumpyBackend
from aw4d.backend_opencl import OpenCLBackend
from aw4d.clip import Clip
from aw4d.errors import InputError
from aw4d.passes import PASSES
from aw4d.pipeline import Plan, Step, inputs

BAR_P9999, BAR_MAX = 1e-5, 1e-4
VECTORS = frozenset({"normal"})  # planes that are directions, not three numbers


def error(values: ArrayLike, reference: ArrayLike, *, vectors: bool = False) -> tuple[float, float]:
    """Largest and 99.99th percentile error of `values` against `reference`, arrays of one shape.

    `|x - ref| / max(|ref|, 1e-3 p99(|ref|))`: relative, with a floor for black.
    A value that is not finite where the reference is counts as infinite.

    With `vectors`, |.| is the length of (..., 3): a direction has one size, however small one of its components is.
    """
    x, ref = np.asarray(values, dtype=np.float64), np.asarray(reference, dtype=np.float64)
    size, off = (np.linalg.norm(v, axis=-1) if vectors else np.abs(v) for v in (ref, x - ref))
    floor = max(1e-3 * float(np.percentile(size, 99)), float(np.finfo(np.float32).tiny))
    wrong = np.where(np.isfinite(off), off, np.inf) / np.maximum(size, floor)
    return float(wrong.max()), float(np.percentile(wrong, 99.99))


@dataclass(frozen=True, kw_only=True)
class Row:
    """One pass, one result, one device: errors of the worst frame."""

    step: str
    plane: str
    device: str
    max_error: float
    p9999_error: float

    @property
    def within(self) -> bool:
        """Whether both errors are inside the bar."""
        return self.max_error <= BAR_MAX and self.p9999_error <= BAR_P9999


def _results(step: Step) -> list[str]:
    entry = PASSES[step.name]
    return [*entry.writes, *entry.layers]


def compare(clip: Clip, made: Plan, frames: Sequence[int]) -> list[Row]:
    """Errors of every usable OpenCL device against NumPy in float64, per pass and per plane or layer that it writes.

    Every pass is given the same float32 planes everywhere: the reference's results of the pass before it, rounded.

    Raises
    ------
    InputError
        No OpenCL device works.
    """
    backends = {f"{r.index} {r.platform}": OpenCLBackend(r.index) for r in opencl.devices() if r.usable}
    if not backends:
        raise InputError("compare: expected an OpenCL device to compare NumPy with, got none (see `aw4d doctor`)")
    worst: dict[tuple[str, str, str], tuple[float, float]] = {}
    for index in frames:
        frame, scene = inputs(clip.frame(index, made.planes), made, index)
        reference = NumpyBackend()
        truth = reference.upload(frame, scene)
        tried = {name: backend.upload(frame, scene, list(made.layers)) for name, backend in backends.items()}
        for step in made.steps:
            names = _results(step)
            reference.run(step.name, truth, step.params)
            expected = reference.download64(truth, names)
            for device, planes in tried.items():
                backend = backends[device]
                backend.run(step.name, planes, step.params)
                for name, values in backend.download(planes, names).items():
                    key = (step.name, name, device)
                    seen = worst.get(key, (0.0, 0.0))
                    now = error(values, expected[name], vectors=name in VECTORS)
                    worst[key] = (max(seen[0], now[0]), max(seen[1], now[1]))
            for name in PASSES[step.name].writes:
                same = expected[name].astype(np.float32)
                reference.put(truth, name, same)
                for device, planes in tried.items():
                    backends[device].put(planes, name, same)
    return [
        Row(step=step, plane=plane, device=device, max_error=largest, p9999_error=p9999)
        for (step, plane, device), (largest, p9999) in worst.items()
    ]


def to_json(rows: Sequence[Row], frames: Sequence[int]) -> dict[str, Any]:
    """The rows and what they were measured on and against."""
    return {
        "measure": "|x - ref| / max(|ref|, 1e-3 p99(|ref|)), worst frame; reference: numpy float64",
        "bar": {"max_error": BAR_MAX, "p9999_error": BAR_P9999},
        "frames": list(frames),
        "rows": [asdict(row) | {"within": row.within} for row in rows],
    }
