"""Where edited frames go: a video or a folder of images, layers, and a sidecar; each appears whole or not at all."""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

import aw4d
from aw4d.backend import Backend
from aw4d.clip import Clip
from aw4d.errors import InputError
from aw4d.io.files import remove_left, replacing, replacing_folder
from aw4d.io.images import exr_channels, write_exr, write_png
from aw4d.io.video import VideoWriter
from aw4d.overlap import ahead
from aw4d.pipeline import Plan
from aw4d.render import EACH_LIGHT, LABELS, Frame, frames_of

FORMATS = ("png", "exr")
VIDEO_SUFFIX = ".mp4"


class Sink(Protocol):
    """Takes frames one after the other."""

    def write(self, frame: Frame) -> None:
        """Write one frame."""


class _Video:
    def __init__(self, writer: VideoWriter) -> None:
        self._writer = writer

    def write(self, frame: Frame) -> None:
        self._writer.write(frame.image)


class _Folder:
    def __init__(self, folder: Path, kind: str) -> None:
        self._folder = folder
        self._kind = kind

    def write(self, frame: Frame) -> None:
        path = self._folder / f"{frame.index:06d}.{self._kind}"
        if self._kind == "exr":
            write_exr(path, exr_channels(frame.rgb))
        else:
            write_png(path, frame.image)


class _Layers:
    """A folder a layer; the boxes of the written frames go into `boxes.json`, by frame, as the clip has them."""

    def __init__(self, folder: Path, clip: Clip, chosen: Sequence[int]) -> None:
        self._folder = folder
        boxes = {index: [box.to_json() for box in clip.info.boxes[index]] for index in chosen if clip.info.boxes}
        (folder / "boxes.json").write_text(json.dumps(boxes, indent=2, allow_nan=False) + "\n", encoding="utf-8")

    def write(self, frame: Frame) -> None:
        for name, values in frame.layers.items():
            (self._folder / name).mkdir(exist_ok=True)
            path = self._folder / name / f"{frame.index:06d}"
            if values.dtype == np.float32:
                write_exr(path.with_suffix(".exr"), exr_channels(values))
            else:  # masks 0 and 255, ids as they are
                write_png(path.with_suffix(".png"), _codes(values))


def _codes(values: NDArray[Any]) -> NDArray[np.uint8] | NDArray[np.uint16]:
    return values.astype(np.uint8) * np.uint8(255) if values.dtype == np.bool_ else values.astype(np.uint16)


def sidecar(clip: Clip, made: Plan, *, backend: str, frames: Sequence[int], seconds: float) -> dict[str, Any]:
    """Everything that made an edit, as JSON."""
    return {
        "aw4d": aw4d.__version__,
        "clip": clip.info.name,
        "licence": clip.info.licence,
        "approximations": clip.info.approximations,
        "weather": made.weather,
        "quality": made.quality,
        "passes": [step.name for step in made.steps],
        "skipped": made.skipped,
        "settings": dataclasses.asdict(made.settings),
        "white_cd_m2": made.lighting.white_cd_m2,
        "illuminance_lux": made.lighting.environment.illuminance,
        "lights": [dataclasses.asdict(light) for light in made.lighting.standing],
        "backend": backend,
        "frames": list(frames),
        "size": [clip.info.width, clip.info.height],
        "fps": clip.info.fps,
        "seconds": round(seconds, 3),
    }


def sidecar_path(out: Path) -> Path:
    """Where the sidecar of an output lies: beside it, `.json` for its suffix."""
    return out.with_suffix(".json") if out.suffix == VIDEO_SUFFIX else out.with_name(out.name + ".json")


def check_target(out: Path, *, kind: str = "png", layer_folder: Path | None = None, overwrite: bool = False) -> None:
    """Refuse, before anything is rendered, a target that cannot be or must not be written.

    Raises
    ------
    InputError
        The kind is unknown or does not go with a video, the suffix is not that of a video, there is no folder to write
        into, or something exists there: with `overwrite` a video, or a folder of an earlier edit, is replaced.
    """
    if kind not in FORMATS:
        raise InputError(f"--format: expected {' or '.join(FORMATS)}, got {kind!r}")
    if out.suffix == VIDEO_SUFFIX and kind != "png":
        raise InputError(f"--format {kind}: expected a folder to write images to, got the video {out}")
    if out.suffix and out.suffix != VIDEO_SUFFIX and not out.is_dir():
        raise InputError(f"{out}: expected a path that ends in {VIDEO_SUFFIX}, or a folder, got {out.suffix}")
    for target in (out, layer_folder):
        if target is not None:
            _check_free(target, out, overwrite)


def _check_free(target: Path, out: Path, overwrite: bool) -> None:
    if not target.parent.is_dir():
        raise InputError(f"{target}: cannot be written (there is no folder {target.parent})")
    if not target.exists() or (target.is_dir() and not any(target.iterdir())):
        return
    if not overwrite:
        raise InputError(f"{target}: exists already; give another path or --overwrite")
    if target.is_dir() and not sidecar_path(out).is_file():
        raise InputError(f"{target}: expected the folder of an earlier edit, with its .json, to overwrite; got another")


@contextmanager
def open_output(out: Path, fps: float, kind: str = "png") -> Iterator[Sink]:
    """A video for a path that ends in .mp4, else a folder of images of that kind."""
    remove_left(out)
    with ExitStack() as stack:
        if out.suffix == VIDEO_SUFFIX:
            yield _Video(stack.enter_context(VideoWriter(out, fps=fps)))
        else:
            yield _Folder(stack.enter_context(replacing_folder(out)), kind)


@contextmanager
def _open_noted(out: Path, fps: float, kind: str) -> Iterator[tuple[Sink, Path]]:
    """The output and the name to write its sidecar to; of a killed run at most one of both is in its place.

    A video has its sidecar after it, since only its end shows whether the disk had room. A folder has it before: only
    beside its sidecar it is known as an edit that may be overwritten.
    """
    note = sidecar_path(out)
    remove_left(note)
    with ExitStack() as stack:
        if out.suffix == VIDEO_SUFFIX:
            temporary = stack.enter_context(replacing(note))
            yield stack.enter_context(open_output(out, fps, kind)), temporary
        else:
            sink = stack.enter_context(open_output(out, fps, kind))
            yield sink, stack.enter_context(replacing(note))


@contextmanager
def _open_layers(folder: Path | None, clip: Clip, chosen: Sequence[int]) -> Iterator[list[Sink]]:
    """The folder of layers, where one is given."""
    with ExitStack() as stack:
        if folder is None:
            yield []
        else:
            remove_left(folder)
            yield [_Layers(stack.enter_context(replacing_folder(folder)), clip, chosen)]


def _write(frames: Iterable[Frame], sinks: Sequence[Sink]) -> None:
    for frame in frames:
        for sink in sinks:
            sink.write(frame)


def _noting_first(frames: Iterable[Frame], first: list[float]) -> Iterator[Frame]:
    """The same frames; `first` gets the time at which the first of them is there."""
    for frame in frames:
        if not first:
            first.append(time.perf_counter())
        yield frame


def write_all(frames: Iterable[Frame], out: Path, *, fps: float, kind: str = "png") -> None:
    """Write every frame into `out`."""
    with open_output(out, fps, kind) as sink:
        _write(frames, [sink])


def write_edit(
    clip: Clip,
    made: Plan,
    backend: Backend,
    chosen: Sequence[int],
    out: Path,
    *,
    kind: str = "png",
    layer_folder: Path | None = None,
    explained: dict[str, Any] | None = None,
    watch: Callable[[Iterable[Frame]], Iterable[Frame]] = lambda frames: frames,
    started: float | None = None,
) -> dict[str, Any]:
    """Edit the chosen frames into `out`, all layers into `layer_folder`, and the sidecar, which is returned.

    `watch` sees every frame on its way, to show progress. Its seconds count from `started`, by `time.perf_counter`, or
    from this call on. What `explained` holds goes into the sidecar.
    """
    start = time.perf_counter() if started is None else started
    first: list[float] = []
    layers = [*made.layers, EACH_LIGHT, LABELS] if layer_folder is not None else []
    with (
        closing(ahead(frames_of(clip, made, backend, chosen, layers, linear=kind == "exr"))) as frames,
        _open_layers(layer_folder, clip, chosen) as layer_sinks,
        _open_noted(out, clip.info.fps, kind) as (sink, note),
    ):
        _write(watch(_noting_first(frames, first)), [sink, *layer_sinks])
        content = sidecar(clip, made, backend=backend.name, frames=chosen, seconds=time.perf_counter() - start)
        content["first_frame_seconds"] = round(first[0] - start, 3)
        if explained is not None:
            content["explained"] = explained
        # Before the output takes its place: where there is no room for its sidecar, there is none for the output.
        note.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    return content
