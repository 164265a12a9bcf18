"""The demo: the built-in street in every weather, one video each, and a contact sheet."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from aw4d.backend import Backend
from aw4d.clip import Clip
from aw4d.colour import decode_srgb8, encode_srgb8
from aw4d.io.images import write_png
from aw4d.output import write_all, write_edit
from aw4d.overlap import ahead
from aw4d.pipeline import plan
from aw4d.render import Frame
from aw4d.weathers import WEATHERS

Progress = Callable[[Iterable[Frame], str], Iterator[Frame]]
COLUMNS = 3  # moments of the clip on the contact sheet
THUMB_WIDTH = 640  # [px]


def _source(clip: Clip) -> Iterator[Frame]:
    for index in range(len(clip)):
        frame = clip.frame(index, ["rgb"])
        yield Frame(index=index, time=frame.time, image=encode_srgb8(frame["rgb"]), layers={})


def _thumb(frame: Frame, text: str) -> NDArray[np.uint8]:
    """A frame at thumbnail size, averaged in linear light, with a caption."""
    height, width = frame.image.shape[:2]
    size = (THUMB_WIDTH, max(1, round(THUMB_WIDTH * height / width)))
    small = cv2.resize(decode_srgb8(frame.image), size, interpolation=cv2.INTER_AREA)
    image = encode_srgb8(np.asarray(small, np.float32))
    (length, _), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.8, 1)
    image[:40, : length + 24] //= 3  # a dark plate: white letters must be read on fog and snow
    cv2.putText(image, text, (12, 28), cv2.FONT_HERSHEY_SIMPLEX, 0.8, (255, 255, 255), 1, cv2.LINE_AA)
    return image


class _Thumbs:
    """Passes frames on and keeps thumbnails of a few moments."""

    def __init__(self, count: int) -> None:
        self.moments = set(np.linspace(0, count - 1, COLUMNS).round().astype(int).tolist())
        self.images: list[NDArray[np.uint8]] = []

    def watch(self, frames: Iterable[Frame], weather: str) -> Iterator[Frame]:
        for frame in frames:
            if frame.index in self.moments:
                self.images.append(_thumb(frame, f"{weather}, {frame.time:.1f} s"))
            yield frame

    def row(self) -> NDArray[np.uint8]:
        """The thumbnails side by side."""
        return np.concatenate(self.images, axis=1)


def run(clip: Clip, out: Path, backend: Backend, progress: Progress) -> list[Path]:
    """Render the source and every weather into `out`; returns the files, the contact sheet last.

    `progress` is given the frames of one video and its name, and passes them on.
    """
    files, rows = [out / "source.mp4"], []
    thumbs = _Thumbs(len(clip))
    write_all(progress(ahead(thumbs.watch(_source(clip), "source")), "source"), files[0], fps=clip.info.fps)
    rows.append(thumbs.row())
    for weather in WEATHERS:
        thumbs = _Thumbs(len(clip))
        made = plan(clip, weather)
        files.append(out / f"{weather}.mp4")
        watch = partial(_watched, thumbs, progress, weather)
        write_edit(clip, made, backend, range(len(clip)), files[-1], watch=watch)
        rows.append(thumbs.row())
    sheet = out / "contact_sheet.png"
    write_png(sheet, np.concatenate(rows, axis=0))
    return [*files, sheet]


def _watched(thumbs: _Thumbs, progress: Progress, weather: str, frames: Iterable[Frame]) -> Iterator[Frame]:
    return progress(thumbs.watch(frames, weather), weather)
