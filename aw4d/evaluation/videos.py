"""Videos to be measured: a file, a folder of pictures or a clip, each read in order, a frame at a time."""

from __future__ import annotations

import contextlib
import json
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aw4d.clip import Clip
from aw4d.colour import encode_srgb8
from aw4d.errors import InputError
from aw4d.io.files import listed
from aw4d.io.images import PICTURES, read_rgb
from aw4d.io.video import frame_times, read_video
from aw4d.output import sidecar_path

VIDEO_SUFFIXES = (".mp4", ".m4v", ".mov", ".mkv", ".webm", ".avi")


@dataclass(frozen=True, kw_only=True)
class Video:
    """Frames of one size, read when asked for.

    Parameters
    ----------
    path
        File or folder.
    count, height, width
        Number of frames and their size [px].
    fps
        Frames a second; None where nothing says so.
    frames
        Frames of an ascending range, in order: pictures, (H, W, 3) sRGB uint8, or depths, (H, W) float32.
    names
        What the frames' files are called, without suffix; None where they are not files of their own.
    """

    path: Path
    count: int
    height: int
    width: int
    fps: float | None
    frames: Callable[[range], Iterator[NDArray[Any]]]
    names: tuple[str, ...] | None = None

    @property
    def name(self) -> str:
        """What a video is paired by."""
        return stem(self.path)


def stem(path: Path) -> str:
    """Name of a file or a clip without its suffix; name of another folder as it is."""
    return path.name if path.is_dir() and path.suffix != ".clip" else path.stem


def is_clip(path: Path) -> bool:
    """Whether the path is a clip's folder."""
    return (path / "zarr.json").is_file()


def in_order(folder: Path, suffixes: tuple[str, ...]) -> list[Path]:
    """Files of a folder with one of the suffixes, numbers in their names taken as numbers: 2 before 10.

    Raises
    ------
    InputError
        There are files of several kinds, and which of them are the frames is not clear.
    """

    def key(path: Path) -> list[tuple[str, int]]:
        return [(word, int(number or -1)) for word, number in re.findall(r"(\D*)(\d*)", path.name)]

    files = listed(folder, suffixes)
    kinds = sorted({path.suffix.lower() for path in files})
    if len(kinds) > 1:
        raise InputError(f"{folder}: expected frames of one kind of file, got {' and '.join(kinds)}")
    return sorted(files, key=key)


def is_video(path: Path) -> bool:
    """Whether the path is one video: a file, a folder of pictures or a clip."""
    if path.is_dir():
        return is_clip(path) or bool(listed(path, PICTURES))
    return path.is_file() and path.suffix.lower() in VIDEO_SUFFIXES


def open_video(path: Path) -> Video:
    """A video file, a folder of PNG or JPEG pictures in the order of their names, or the pictures of a clip.

    Raises
    ------
    InputError
        It is none of these, or is damaged or truncated.
    """
    if is_clip(path):
        return _clip(path)
    return _folder(path) if path.is_dir() else _file(path)


def check_size(path: Path, index: int, frame: NDArray[Any], height: int, width: int) -> NDArray[Any]:
    """The frame, if it has the size of the first one.

    Raises
    ------
    InputError
        It has another size.
    """
    if frame.shape[:2] != (height, width):
        got = f"{frame.shape[1]}x{frame.shape[0]}"
        raise InputError(f"{path}: frame {index}: expected {width}x{height} as the first, got {got}")
    return frame


def _file(path: Path) -> Video:
    times = frame_times(path)
    first = next(read_video(path), None)
    if first is None:
        raise InputError(f"{path}: expected frames, got none that can be decoded")
    height, width = _edited_size(path, first)

    def frames(wanted: range) -> Iterator[NDArray[np.uint8]]:
        pictures = read_video(path)
        for index in range(wanted[-1] + 1):
            picture = next(pictures, None)
            if picture is None:
                raise InputError(f"{path}: expected {len(times)} frames, got {index} (damaged?)")
            if index in wanted:
                yield check_size(path, index, picture, *first.shape[:2])[:height, :width]

    fps = float((len(times) - 1) / times[-1]) if len(times) > 1 else None
    return Video(path=path, count=len(times), height=height, width=width, fps=fps, frames=frames)


def _edited_size(path: Path, picture: NDArray[np.uint8]) -> tuple[int, int]:
    """Height and width of what was edited: the file of an edit has odd sides continued, and its sidecar tells them."""
    height, width = picture.shape[:2]
    with contextlib.suppress(KeyError, TypeError, ValueError):
        edited_width, edited_height = sidecar_of(path)["size"]
        if (height - edited_height, width - edited_width) == (edited_height % 2, edited_width % 2):
            return edited_height, edited_width
    return height, width


def sidecar_of(path: Path) -> dict[str, Any]:
    """What made an edit, as the file beside it tells; empty where there is none."""
    with contextlib.suppress(OSError, ValueError, RecursionError):
        content = json.loads(sidecar_path(path).read_text(encoding="utf-8"))
        return content if isinstance(content, dict) else {}
    return {}


def _folder(folder: Path) -> Video:
    files = in_order(folder, (*PICTURES, *VIDEO_SUFFIXES))
    if not files or files[0].suffix.lower() not in PICTURES:
        raise InputError(f"{folder}: expected a folder of PNG or JPEG pictures or a clip, got another folder")
    height, width = read_rgb(files[0]).shape[:2]

    def frames(wanted: range) -> Iterator[NDArray[np.uint8]]:
        for index in wanted:
            yield check_size(folder, index, read_rgb(files[index]), height, width)

    names = tuple(file.stem for file in files)
    return Video(path=folder, count=len(files), height=height, width=width, fps=None, frames=frames, names=names)


def _clip(path: Path) -> Video:
    clip = Clip(path)

    def frames(wanted: range) -> Iterator[NDArray[np.uint8]]:
        for index in wanted:
            yield encode_srgb8(clip.frame(index, ["rgb"])["rgb"])

    info = clip.info
    return Video(path=path, count=len(clip), height=info.height, width=info.width, fps=info.fps, frames=frames)
