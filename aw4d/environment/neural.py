"""Ambient radiance that a neural forward renderer made, frame by frame, in place of the analytic one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aw4d.colour import decode_srgb8
from aw4d.errors import InputError
from aw4d.io.images import PICTURES, read_exr_plane, read_rgb

SUFFIXES = (".exr", *PICTURES)


def frame_files(folder: Path) -> list[Path]:
    """The frames of a folder in order of their names: OpenEXR (linear), PNG or JPEG (sRGB).

    Raises
    ------
    InputError
        The folder does not exist or holds no such file.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: expected a folder of rendered frames")
    found = sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES)
    if not found:
        raise InputError(f"{folder}: expected rendered frames ({', '.join(SUFFIXES)}), got none")
    return found


def rendered(folder: Path, index: int, shape: tuple[int, int]) -> NDArray[np.float32]:
    """Ambient radiance of a frame, (H, W, 3) float32, scene-linear, 1 = the picture's white.

    Parameters
    ----------
    folder
        See `frame_files`; the frame's place in the order of names is its number.
    index
        Number of the frame.
    shape
        (height, width) of the clip [px].

    Raises
    ------
    InputError
        There is no such frame, its size is another one, or it cannot be read or holds values that are not finite.
    """
    files = frame_files(folder)
    if not 0 <= index < len(files):
        raise InputError(f"{folder}: expected a rendered frame {index}, got {len(files)} frames")
    path = files[index]
    image = read_exr_plane(path) if path.suffix.lower() == ".exr" else decode_srgb8(read_rgb(path))
    if image.shape != (*shape, 3):
        raise InputError(f"{path}: expected {shape[1]}x{shape[0]} pixels in colour, got {image.shape}")
    if not np.isfinite(image).all():
        raise InputError(f"{path}: expected finite radiance, got NaN or infinite values")
    return np.maximum(image, np.float32(0))
