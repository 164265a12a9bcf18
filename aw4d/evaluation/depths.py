"""Depth of videos to be measured: a folder of maps, an array of Video Depth Anything, or the depth of a clip."""

from __future__ import annotations

import contextlib
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from aw4d.clip import Clip
from aw4d.errors import InputError
from aw4d.evaluation.videos import Video, check_size, in_order, is_clip
from aw4d.io.files import listed
from aw4d.io.planes import read_depth

SUFFIXES = (".npy", ".png", ".exr")
KEY = "depths"  # of an .npz by Video Depth Anything
_BIT_DEPTH_AT = 24  # byte of a PNG that has the number of bits a channel


def is_depth(path: Path) -> bool:
    """Whether the path has the depth of one video."""
    if path.is_dir():
        return is_clip(path) or bool(listed(path, SUFFIXES))
    return path.is_file() and path.suffix.lower() == ".npz"


def open_depth(path: Path) -> Video:
    """Depths (H, W) float32 of a video; 0, negative, NaN or infinite where there is none.

    A folder with a file a frame (.npy or .exr; .png of 16 bits, 256 codes a metre) in the order of their names; an
    .npz with the array `depths` (T, H, W); or a clip, whose sky has no depth.

    Raises
    ------
    InputError
        It is none of these, or is damaged or truncated.
    """
    if is_clip(path):
        return _clip(path)
    return _folder(path) if path.is_dir() else _npz(path)


def _clip(path: Path) -> Video:
    clip = Clip(path)
    missing = {"depth", "sky"}.difference(clip.planes)
    if missing:
        raise InputError(f"{path}: expected a clip with depth and sky, got none of {', '.join(sorted(missing))}")

    def frames(wanted: range) -> Iterator[NDArray[np.float32]]:
        for index in wanted:
            frame = clip.frame(index, ["depth", "sky"])
            yield np.where(frame["sky"], np.float32(0), frame["depth"])  # the sky's is a stand-in, not a measurement

    info = clip.info
    return Video(path=path, count=len(clip), height=info.height, width=info.width, fps=info.fps, frames=frames)


def _read(path: Path) -> NDArray[np.float32]:
    depth = read_depth(path, None)
    if path.suffix.lower() == ".png":
        with path.open("rb") as file:
            bits = file.read(_BIT_DEPTH_AT + 1)[-1]
        if bits != 16:
            raise InputError(f"{path}: expected depth as a PNG of 16 bits, got {bits} bits")
    return depth


def _folder(folder: Path) -> Video:
    files = in_order(folder, SUFFIXES)
    if not files:
        raise InputError(f"{folder}: expected a folder of .npy, .exr or .png files or a clip, got another folder")
    height, width = _read(files[0]).shape

    def frames(wanted: range) -> Iterator[NDArray[np.float32]]:
        for index in wanted:
            yield check_size(folder, index, _read(files[index]), height, width)

    names = tuple(file.stem for file in files)
    return Video(path=folder, count=len(files), height=height, width=width, fps=None, frames=frames, names=names)


@contextlib.contextmanager
def _member(path: Path) -> Iterator[tuple[IO[bytes], tuple[int, int, int], np.dtype[np.floating]]]:
    """The array of an .npz as a stream that stands at its first number, its shape and its dtype.

    NumPy would read all of it: it maps no file that lies inside another.
    """
    try:
        with zipfile.ZipFile(path) as archive, archive.open(f"{KEY}.npy") as stream:
            major, _ = np.lib.format.read_magic(stream)
            header = np.lib.format.read_array_header_1_0 if major == 1 else np.lib.format.read_array_header_2_0
            shape, by_columns, dtype = header(stream)
            if len(shape) != 3 or not all(shape) or by_columns or dtype.kind != "f":
                raise InputError(f"{path}: {KEY}: expected floats (T, H, W) in rows, got {shape} {dtype}")
            yield stream, (shape[0], shape[1], shape[2]), dtype
    except KeyError as error:
        raise InputError(f"{path}: expected an array named {KEY}, got others only") from error
    except (OSError, ValueError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: expected a whole .npz file ({error})") from error


def _npz(path: Path) -> Video:
    with _member(path) as (_, (count, height, width), _):
        pass

    def frames(wanted: range) -> Iterator[NDArray[np.float32]]:
        with _member(path) as (stream, _, dtype):
            size = height * width * dtype.itemsize
            for index in range(wanted[-1] + 1):
                data = stream.read(size)
                if len(data) < size:
                    raise InputError(f"{path}: truncated after {index} of {count} frames")
                if index in wanted:
                    with np.errstate(over="ignore"):
                        yield np.frombuffer(data, dtype).reshape(height, width).astype(np.float32)

    return Video(path=path, count=count, height=height, width=width, fps=None, frames=frames)
