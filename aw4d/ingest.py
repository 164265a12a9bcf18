"""Turns a recording into a clip: planes of every frame in parallel, then what only the whole clip can tell."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aw4d import street
from aw4d.boxes import Box
from aw4d.calibrate.sky_depth import DepthPercentile
from aw4d.camera import Camera
from aw4d.clip import Clip, ClipInfo, ClipWriter
from aw4d.errors import InputError
from aw4d.extract.frame import APPROXIMATIONS, PROVENANCE, extract_frame
from aw4d.extract.relative import MetricDepth, metric_depth
from aw4d.gbuffer import GBuffer, Plane, check_depth_unit
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
    points: NDArray[np.float32] | None = None


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


def _tasks(source: Source, indices: Sequence[int], metric: MetricDepth | None) -> Iterator[_Task]:
    info = source.info
    for index in indices:
        given = source.planes(index)
        if metric is not None:
            given["depth"] = metric.apply(given["depth"])
            check_depth_unit(given["depth"], given.get("sky"))
        yield _Task(
            index=index,
            rgb=source.rgb(index),
            camera=info.camera(index),
            time=float(info.times[index]),
            points=source.points(index),
            boxes=info.boxes[index] if info.boxes else [],
            given=given,
            camera_height_m=source.camera_height_m,
        )


def _street_frame(index: int, *, width: int, height: int) -> _Frame:
    return _Frame(index=index, planes=street.frame(index, width=width, height=height))


def _whole_clip(writer: ClipWriter, info: ClipInfo) -> ClipInfo:
    """Mean radiance of sky and ground, and the sky's depth: that of the source, or else a percentile of the clip.

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
    environment = {name: (radiance[name] / pixels[name]).tolist() for name in radiance if pixels[name]}
    if info.sky_depth_m is not None:
        return replace(info, environment=environment)
    sky_depth_m = percentile.value(SKY_PERCENTILE)
    _set_sky_depth(writer, len(info), sky_depth_m)
    return replace(info, environment=environment, sky_depth_m=sky_depth_m)


def _set_sky_depth(writer: ClipWriter, count: int, sky_depth_m: float) -> None:
    for index in range(count):
        sky = writer.read_back("sky", index)
        if sky.any():
            writer.rewrite("depth", index, np.where(sky, np.float32(sky_depth_m), writer.read_back("depth", index)))


def _whole_frames(frames: Iterator[_Frame], writer: ClipWriter) -> Iterator[_Frame]:
    """The frames; a faulty recording ends the work for good, where a kill or a full disk leaves it to be resumed."""
    try:
        yield from frames
    except InputError:
        writer.discard()
        raise


def _write(
    info: ClipInfo,
    frames: Callable[[Sequence[int]], Iterator[_Frame]],
    out: str | Path,
    *,
    fingerprint: str,
    overwrite: bool,
    progress: Progress,
) -> Clip:
    """Write the frames that an earlier run has not, then finish the clip."""
    count, shape = len(info), (len(info), info.height, info.width)
    made_by = f"{fingerprint} {version('autoweather4d')}"  # another version extracts other planes
    with ClipWriter(out, shape, fingerprint=made_by, overwrite=overwrite) as writer:
        remaining = [index for index in range(count) if index not in writer.done]
        progress(count - len(remaining), count)
        for done, frame in enumerate(_whole_frames(frames(remaining), writer), start=count - len(remaining) + 1):
            writer.write(frame.index, frame.planes, frame.points)
            progress(done, count)
        return writer.finish(_whole_clip(writer, info))


def _described(source: Source, metric: MetricDepth | None) -> ClipInfo:
    """The source's info with the provenance of the planes that are derived here, and what is approximate in them."""
    given = source.planes(0)
    provenance = {name: text for name, text in PROVENANCE.items() if name not in given} | source.info.provenance
    if metric is not None:
        provenance["depth"] = metric.origin
    estimated = [text for name, text in APPROXIMATIONS.items() if name not in given]
    return replace(source.info, provenance=provenance, approximations=[*source.info.approximations, *estimated])


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
        Processes that extract planes; by default one a core. A script that uses more than one needs the usual
        `if __name__ == "__main__"`.
    progress
        Called with the frames done and the frames in all.

    Raises
    ------
    InputError
        The recording is faulty (then nothing is left behind), or the target cannot be written.
    """
    metric = metric_depth(source) if source.relative_depth else None
    return _write(
        _described(source, metric),
        lambda indices: ordered_map(_extract, _tasks(source, indices, metric), workers=workers or os.cpu_count() or 1),
        out,
        fingerprint=source.fingerprint,
        overwrite=overwrite,
        progress=progress,
    )


def ingest_street(
    out: str | Path,
    *,
    frames: int = street.FRAMES,
    width: int = 1280,
    height: int = 704,
    overwrite: bool = False,
    workers: int | None = None,
    progress: Progress = silent,
) -> Clip:
    """Write the built-in street as a clip; all its planes are exact.

    Parameters
    ----------
    out
        The clip to write.
    frames
        Frames from the first one on, at least 1.
    width, height
        Size [px].
    overwrite, workers, progress
        As for `ingest`.

    Raises
    ------
    InputError
        The number of frames or the size is not positive, or the target cannot be written.
    """
    if frames < 1:
        raise InputError(f"frames: expected at least 1, got {frames}")
    cameras = [street.camera(index, width=width, height=height) for index in range(frames)]
    info = ClipInfo(
        name="street",
        width=width,
        height=height,
        K=np.stack([camera.K for camera in cameras]),
        camera_to_world=np.stack([camera.camera_to_world for camera in cameras]),
        times=np.arange(frames) / street.RATE,
        provenance={"all": "the built-in procedural street, exact at pixel centres"},
        licence="part of AutoWeather4D, Apache-2.0",
        sky_depth_m=street.SKY_DEPTH_M,
        boxes=[street.boxes(index) for index in range(frames)],
    )
    shot = partial(_street_frame, width=width, height=height)
    return _write(
        info,
        lambda indices: ordered_map(shot, indices, workers=workers or os.cpu_count() or 1),
        out,
        fingerprint=f"street {width}x{height}, {frames} frames",
        overwrite=overwrite,
        progress=progress,
    )
