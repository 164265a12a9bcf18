"""Turns a recording into a clip: planes of every frame in parallel, then what only the whole clip can tell."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aw4d.boxes import Box
from aw4d.calibrate.sky_depth import DepthPercentile
from aw4d.camera import Camera
from aw4d.clip import Clip, ClipInfo, ClipWriter
from aw4d.errors import InputError
from aw4d.extract.frame import PROVENANCE, extract_frame
from aw4d.gbuffer import GBuffer, Plane
from aw4d.io.source import Source
from aw4d.pool import ordered_map

Progress = Callable[[int, int], None]

SKY_PERCENTILE = 99.0


def silent(done: int, total: int) -> None:
    """Progress that nobody watches."""


@dataclass(frozen=True, kw_only=True)
class _Task:
    index: int
    rgb: NDArray[np.uint8]
    camera: Camera
    time: float
    points: NDArray[np.float32] | None
    boxes: Sequence[Box]
    given: dict[str, Plane]
    camera_height_m: float | None


@dataclass(frozen=True, kw_only=True)
class _Frame:
    index: int
    planes: GBuffer
    points: NDArray[np.float32] | None


def _extract(task: _Task) -> _Frame:
    try:
        planes = extract_frame(
            task.rgb,
            camera=task.camera,
            points=task.points,
            boxes=task.boxes,
            given=task.given,
            camera_height_m=task.camera_height_m,
        )
        gbuffer = GBuffer(planes, camera=task.camera, time=task.time)
    except InputError as error:
        raise InputError(f"frame {task.index}: {error}") from error
    return _Frame(index=task.index, planes=gbuffer, points=task.points)


def _tasks(source: Source, indices: Sequence[int]) -> Iterator[_Task]:
    info = source.info
    for index in indices:
        yield _Task(
            index=index,
            rgb=source.rgb(index),
            camera=info.camera(index),
            time=float(info.times[index]),
            points=source.points(index),
            boxes=info.boxes[index] if info.boxes else [],
            given=source.planes(index),
            camera_height_m=source.camera_height_m,
        )


def _mean(total: NDArray[np.float64], count: int) -> list[float]:
    return [float(value) for value in total / count]


def _whole_clip(writer: ClipWriter, info: ClipInfo) -> ClipInfo:
    """Second pass: the depth that the sky is given, and the mean radiance of sky and ground.

    Reads depth outside the sky only, so that it can be repeated after a kill half-way.
    """
    percentile = DepthPercentile()
    radiance = {"sky": np.zeros(3), "ground": np.zeros(3)}
    pixels = {"sky": 0, "ground": 0}
    for index in range(len(info)):
        sky, rgb = writer.read_back("sky", index), writer.read_back("rgb", index)
        percentile.add(writer.read_back("depth", index), sky)
        for name, mask in (("sky", sky), ("ground", ~sky)):
            radiance[name] += rgb[mask].sum(axis=0, dtype=np.float64)
            pixels[name] += int(np.count_nonzero(mask))
    sky_depth_m = percentile.value(SKY_PERCENTILE)
    for index in range(len(info)):
        sky = writer.read_back("sky", index)
        if sky.any():
            depth = np.where(sky, np.float32(sky_depth_m), writer.read_back("depth", index))
            writer.rewrite("depth", index, depth)
    environment = {name: _mean(radiance[name], pixels[name]) for name in radiance if pixels[name]}
    return replace(info, sky_depth_m=sky_depth_m, environment=environment)


def _provenance(source: Source, given: dict[str, Plane]) -> dict[str, str]:
    derived = {name: text for name, text in PROVENANCE.items() if name not in given}
    return derived | source.info.provenance


def ingest(
    source: Source,
    out: str | Path,
    *,
    overwrite: bool = False,
    workers: int | None = None,
    progress: Progress = silent,
) -> Clip:
    """Write a recording as a clip; a run that was interrupted or killed is continued by the next one.

    Parameters
    ----------
    source
        The recording, from a reader in `aw4d.io`.
    out
        The clip to write.
    overwrite
        Replace an existing clip.
    workers
        Processes that extract planes; by default one a core.
    progress
        Called with the frames done and the frames in all.

    Raises
    ------
    InputError
        The recording is faulty (then nothing is left behind), or the target cannot be written.
    """
    info = source.info
    shape = (len(info), info.height, info.width)
    with ClipWriter(out, shape, fingerprint=source.fingerprint, overwrite=overwrite) as writer:
        remaining = [index for index in range(len(info)) if index not in writer.done]
        progress(len(info) - len(remaining), len(info))
        frames = ordered_map(_extract, _tasks(source, remaining), workers=workers or os.cpu_count() or 1)
        for count, frame in enumerate(_discarding(writer, frames), start=1):
            writer.write(frame.index, frame.planes, frame.points)
            progress(len(info) - len(remaining) + count, len(info))
        info = replace(info, provenance=_provenance(source, source.planes(0)))
        return writer.finish(_whole_clip(writer, info))


def _discarding(writer: ClipWriter, frames: Iterator[_Frame]) -> Iterator[_Frame]:
    """The frames; a faulty recording ends the work for good, where a kill or a full disk leaves it to be resumed."""
    try:
        yield from frames
    except InputError:
        writer.discard()
        raise
