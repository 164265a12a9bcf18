"""Pictures of labels to be measured: a folder of 8-bit PNG files with train ids."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aw4d.errors import InputError
from aw4d.evaluation.pairs import Kind, Pair, Selection, pairs
from aw4d.evaluation.videos import Video, check_size, in_order
from aw4d.io.files import listed
from aw4d.io.images import PNG, read_png


def is_labels(path: Path) -> bool:
    """Whether the path is a folder of label pictures."""
    return path.is_dir() and bool(listed(path, PNG))


def open_labels(folder: Path) -> Video:
    """Train ids (H, W) uint8 of a video, a PNG file a frame in the order of their names.

    Raises
    ------
    InputError
        There are none, or a file is damaged, has colours or more than 8 bits.
    """
    files = in_order(folder, PNG)
    if not files:
        raise InputError(f"{folder}: expected label pictures (.png), got none")
    height, width = _read(files[0]).shape

    def frames(wanted: range) -> Iterator[NDArray[np.uint8]]:
        for index in wanted:
            yield check_size(folder, index, _read(files[index]), height, width)

    names = tuple(file.stem for file in files)
    return Video(path=folder, count=len(files), height=height, width=width, fps=None, frames=frames, names=names)


def _read(path: Path) -> NDArray[np.uint8]:
    codes = read_png(path)
    if codes.ndim != 2 or codes.dtype != np.uint8:
        raise InputError(f"{path}: expected train ids, (H, W) of 8 bits, got {codes.shape} {codes.dtype.name}")
    return codes.astype(np.uint8, copy=False)


_LABELS = Kind("folder of labels", "a folder of .png files", is_labels, open_labels)


def label_pairs(ref: Path, gen: Path, selection: Selection, csv_file: Path | None = None) -> list[Pair]:
    """Pairs of label pictures, as `video_pairs`."""
    return pairs(_LABELS, ref, gen, selection, csv_file)
