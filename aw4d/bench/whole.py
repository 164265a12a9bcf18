"""End to end: where the time of an edit goes, stage by stage, and against decoding and encoding alone."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from aw4d.backend_opencl import OpenCLBackend
from aw4d.clip import Clip
from aw4d.colour import encode_srgb8
from aw4d.io.video import VideoWriter
from aw4d.output import write_edit
from aw4d.overlap import mapped_ahead
from aw4d.passes import IMAGE
from aw4d.pipeline import Plan, inputs, plan

STAGES = ("decode", "prepare", "upload", "passes", "download", "encode")


@dataclass(frozen=True, kw_only=True)
class WholeRow:
    """An edit of some frames.

    `stages_ms` is each stage's time a frame, one after the other; `edit_s` the wall time of the edit, in which they
    overlap; `bare_s` that of decoding and encoding the same frames with the same settings of the codec; `ratio` the
    former over the latter.
    """

    weather: str
    frames: int
    stages_ms: dict[str, float]
    edit_s: float
    bare_s: float
    ratio: float


def measure(
    clip: Clip, weathers: Sequence[str], frames: int, staged: int, backend: OpenCLBackend, folder: Path
) -> list[WholeRow]:
    """Edit `frames` frames, those of the clip over and over; stages are timed on `staged` of them."""
    chosen = [index % len(clip) for index in range(frames)]
    bare: dict[tuple[str, ...], float] = {}  # by the planes that are decoded
    rows = []
    for weather in weathers:
        made = plan(clip, weather)
        stages = _stages(clip, made, chosen[:staged], backend, folder / "staged.mp4")  # builds the kernels, too
        if made.planes not in bare:
            bare[made.planes] = _bare(clip, made.planes, chosen, folder / "bare.mp4")
        bare_s = bare[made.planes]
        start = time.perf_counter()
        write_edit(clip, made, backend, chosen, folder / f"{weather}.mp4")
        edit_s = time.perf_counter() - start
        rows.append(
            WholeRow(
                weather=weather,
                frames=frames,
                stages_ms=stages,
                edit_s=edit_s,
                bare_s=bare_s,
                ratio=edit_s / bare_s,
            )
        )
    return rows


def _bare(clip: Clip, planes: Sequence[str], chosen: Sequence[int], out: Path) -> float:
    """Wall time [s] of decoding what a weather reads and encoding the recorded picture, as an edit does both."""
    decoded = tuple(dict.fromkeys(("rgb", *planes)))
    start = time.perf_counter()
    with VideoWriter(out, fps=clip.info.fps) as writer:
        for frame in mapped_ahead(partial(clip.frame, planes=decoded), chosen):
            writer.write(encode_srgb8(frame["rgb"]))
    return time.perf_counter() - start


def _stages(clip: Clip, made: Plan, chosen: Sequence[int], backend: OpenCLBackend, out: Path) -> dict[str, float]:
    """Milliseconds a frame of each stage, the first frame left out: it builds the kernels."""
    took = dict.fromkeys(STAGES, 0.0)
    with VideoWriter(out, fps=clip.info.fps) as writer:
        for number, index in enumerate(chosen):
            marks = [time.perf_counter()]
            source = clip.frame(index, made.planes)
            marks.append(time.perf_counter())
            frame, scene = inputs(source, made, index)
            marks.append(time.perf_counter())
            planes = backend.upload(frame, scene)
            backend.finish()
            marks.append(time.perf_counter())
            for step in made.steps:
                backend.run(step.name, planes, step.params)
            backend.finish()
            marks.append(time.perf_counter())
            image = backend.download(planes, [IMAGE])[IMAGE]
            marks.append(time.perf_counter())
            writer.write(image)
            marks.append(time.perf_counter())
            for stage, before, after in zip(STAGES, marks[:-1], marks[1:], strict=True):
                took[stage] += (after - before) * (number > 0)
    return {stage: seconds * 1e3 / max(len(chosen) - 1, 1) for stage, seconds in took.items()}
