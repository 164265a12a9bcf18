"""One run of the bench: section by section, in one process, the machine's limits before and after."""

from __future__ import annotations

import json
import logging
import os
import platform
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from itertools import chain, product
from pathlib import Path

import numpy as np
from rich.console import Console

import aw4d
from aw4d import opencl
from aw4d.backend_opencl import OpenCLBackend
from aw4d.bench import against, curves, fronts, passes, quality, whole
from aw4d.bench.found import Found
from aw4d.bench.frames import AT, FRAME, for_camera, random_frame, street_frame, with_planes
from aw4d.bench.left_out import LeftOut
from aw4d.bench.limits import Limits, best, limits
from aw4d.bench.passes import Case, Reference
from aw4d.bench.tables import show, to_markdown
from aw4d.clip import Clip
from aw4d.errors import InputError
from aw4d.gbuffer import GBuffer
from aw4d.ingest import ingest_street
from aw4d.io.files import replacing
from aw4d.pipeline import plan

log = logging.getLogger("aw4d")


@dataclass(frozen=True, kw_only=True)
class Scale:
    """How much is measured.

    Parameters
    ----------
    sizes
        Of the passes [px].
    at
        Size of everything else [px].
    runs
        Of everything that is timed on a device.
    numpy_s, longest_s
        All that the reference may take, and one run of it [s].
    clip_frames
        Frames of the street that are drawn; an edit takes them over and over.
    edit_frames, staged
        Frames of an edit, and of its stages one after the other.
    lengths
        Numbers of frames between which memory must not grow.
    weathers
        That are edited.
    """

    sizes: tuple[tuple[int, int], ...]
    at: tuple[int, int]
    runs: int
    numpy_s: float
    longest_s: float
    clip_frames: int
    edit_frames: int
    staged: int
    lengths: tuple[int, int]
    weathers: tuple[str, ...]


FULL = Scale(
    sizes=((640, 352), AT, (1920, 1280), (3840, 2160)),
    at=AT,
    runs=9,
    numpy_s=100,
    longest_s=10,
    clip_frames=8,
    edit_frames=57,
    staged=9,
    lengths=curves.LENGTHS,
    weathers=("snow", "rain", "fog", "overcast", "dawn", "dusk", "night"),
)
QUICK = Scale(
    sizes=((96, 54),),
    at=(96, 54),
    runs=2,
    numpy_s=60,
    longest_s=10,
    clip_frames=FRAME + 1,
    edit_frames=4,
    staged=3,
    lengths=(3, 12),
    weathers=("fog",),
)


def run_bench(
    clips: Sequence[Path],
    console: Console,
    *,
    json_file: Path | None = None,
    plots: Path | None = None,
    markdown: Path | None = None,
    quick: bool = False,
    absent: Sequence[str] = (),
) -> Found:
    """Measure, print, and write what is asked for; `absent` names packages of peers that count as not installed.

    Raises
    ------
    InputError
        No OpenCL device works, or a clip cannot be read.
    """
    opened = [Clip(path) for path in clips]
    found = _measure(opened, QUICK if quick else FULL, absent)
    show(found, console)
    if json_file is not None:
        _write(json_file, json.dumps(found.to_json(), indent=1, allow_nan=False) + "\n")
    if markdown is not None:
        _write(markdown, to_markdown(found, "aw4d bench" + (" --quick" if quick else "")))
    if plots is not None:
        from aw4d.bench.plots import write_plots

        write_plots(found, plots)
    return found


def _write(path: Path, text: str) -> None:
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _measure(clips: Sequence[Clip], scale: Scale, absent: Sequence[str]) -> Found:
    reports = opencl.devices()
    backends = [OpenCLBackend(report.index) for report in reports if report.usable]
    if not backends:
        raise InputError("bench: expected an OpenCL device to measure, got none (see `aw4d doctor`)")
    found = Found(about=_about())
    found.left_out = [LeftOut(what=r.label, why=r.problem) for r in reports if not r.usable]
    if not clips:
        found.left_out.append(LeftOut(what="passes on a recording", why="no --clip was given"))
    with tempfile.TemporaryDirectory(prefix="aw4d-bench-") as name:
        folder = Path(name)
        with _timed(found, "street"):
            width, height = scale.at
            street = ingest_street(folder / "street.clip", frames=scale.clip_frames, width=width, height=height)
            frames = {size: street_frame(*size) for size in dict.fromkeys((*scale.sizes, scale.at))}
        with _timed(found, "limits"):
            before = [limits(backend) for backend in backends]
        bench = _Bench(found, scale, street, frames, backends, before)
        for section in (bench.passes, bench.peers, bench.knobs, bench.qualities, bench.curves):
            with _timed(found, section.__name__):
                section(clips, absent)
        with _timed(found, "whole"):
            chosen = OpenCLBackend()
            found.whole = whole.measure(street, scale.weathers, scale.edit_frames, scale.staged, chosen, folder)
        with _timed(found, "memory"):
            found.memory = curves.by_length(street, folder, scale.lengths)
        with _timed(found, "limits"):
            found.limits = [best(old, limits(backend)) for old, backend in zip(before, backends, strict=True)]
    found.passes = [passes.with_limits(row, found.limits) for row in found.passes]
    return found


def _about() -> dict[str, str]:
    cpu = next(
        (line.split(":")[1].strip() for line in _lines(Path("/proc/cpuinfo")) if line.startswith("model name")),
        platform.processor() or platform.machine(),
    )
    return {
        "aw4d": aw4d.__version__,
        "processor": f"{cpu}, {os.cpu_count()} cores",
        "Python": platform.python_version(),
        "NumPy": np.__version__,
        "pyopencl": version("pyopencl"),
    }


def _lines(path: Path) -> list[str]:
    return path.read_text(encoding="utf-8").splitlines() if path.is_file() else []


@contextmanager
def _timed(found: Found, name: str) -> Iterator[None]:
    log.info("bench: %s", name)
    start = time.perf_counter()
    yield
    found.seconds[name] = found.seconds.get(name, 0.0) + time.perf_counter() - start


def _recorded(clips: Sequence[Clip]) -> Iterator[Case]:
    for clip, weather in product(clips, passes.MEASURED):
        made, index = plan(clip, weather), len(clip) // 2
        yield Case(scene=clip.info.name, frame=clip.frame(index, made.planes), index=index, made=made)


class _Bench:
    """The sections that share frames and devices."""

    def __init__(
        self,
        found: Found,
        scale: Scale,
        street: Clip,
        frames: dict[tuple[int, int], GBuffer],
        backends: Sequence[OpenCLBackend],
        measured: Sequence[Limits],
    ) -> None:
        self.found, self.scale, self.street = found, scale, street
        self.frames, self.backends, self.limits = frames, backends, measured
        self.frame = frames[scale.at]

    def passes(self, clips: Sequence[Clip], absent: Sequence[str]) -> None:
        """Every pass on every backend: the street and random planes at all sizes, and a frame of each clip.

        Large sizes come last: the time that the reference may take ends there, not on a clip.
        """
        reference = Reference(left_s=self.scale.numpy_s, longest_s=self.scale.longest_s)
        large = [size for size in self.scale.sizes if size[0] > self.scale.at[0]]
        small = [size for size in self.scale.sizes if size not in large]
        for case in chain(self._drawn(small), _recorded(clips), self._drawn(large)):
            rows, left_out = passes.measure(case, self.backends, self.limits, reference, self.scale.runs)
            self.found.passes += rows
            self.found.left_out += left_out
        self.found.pixels = curves.by_pixels(self.found.passes)

    def _drawn(self, sizes: Sequence[tuple[int, int]]) -> Iterator[Case]:
        for size, scene, weather in product(sizes, ("street", "random"), passes.MEASURED):
            frame = self.frames[size] if scene == "street" else random_frame(self.frames[size].camera)
            made = for_camera(plan(self.street, weather), frame.camera)
            yield Case(scene=scene, frame=with_planes(frame, made.planes), index=FRAME, made=made)

    def peers(self, clips: Sequence[Clip], absent: Sequence[str]) -> None:
        """Peers of the same arithmetic, and what people use today."""
        measures: tuple[Callable[[], tuple[list[against.PeerRow], list[LeftOut]]], ...] = (
            lambda: against.measure(self.frame, self.backends, self.scale.runs, absent),
            lambda: against.today(self.frame, self.scale.runs, absent),
        )
        for measure, rows in zip(measures, (self.found.peers, self.found.today), strict=True):
            seen, left_out = measure()
            rows += seen
            self.found.left_out += left_out

    def knobs(self, clips: Sequence[Clip], absent: Sequence[str]) -> None:
        """Speed against error, on the device that an edit would take."""
        backend = OpenCLBackend()
        for knob in fronts.KNOBS:
            self.found.knobs += fronts.turn(knob, self.street, self.frame, FRAME, backend, self.scale.runs)
        self.found.knobs += fronts.half_resolution(self.street, self.frame, FRAME, backend, self.scale.runs)
        for weather in passes.MEASURED:
            made = plan(self.street, weather)
            case = Case(scene="street", frame=with_planes(self.frame, made.planes), index=FRAME, made=made)
            self.found.half_planes += fronts.half_planes(case, backend)

    def qualities(self, clips: Sequence[Clip], absent: Sequence[str]) -> None:
        """Time and error of every quality, on the street and on each clip."""
        backend = OpenCLBackend()
        for clip in (self.street, *clips):
            for weather in self.scale.weathers:
                frames = [min(FRAME, len(clip) - 1)]
                self.found.qualities += quality.points(backend, clip, weather, frames=frames, runs=self.scale.runs)

    def curves(self, clips: Sequence[Clip], absent: Sequence[str]) -> None:
        """Cost by lights and by particles."""
        for backend in self.backends:
            self.found.costs += curves.by_lights(self.frame, backend, self.scale.runs)
            self.found.costs += curves.by_particles(self.street, self.frame, FRAME, backend, self.scale.runs)
