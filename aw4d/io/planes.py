"""Plane files that others made: which numbers a file holds, and how they become a plane of ours."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aw4d.colour import decode_srgb8
from aw4d.errors import InputError
from aw4d.gbuffer import DEPTH_MAX, INSTANCE_MAX, Plane
from aw4d.io.files import read_bytes
from aw4d.io.images import PICTURES, read_exr_plane, read_png, read_rgb
from reference_numpy.srgb import srgb_to_linear

SUFFIXES = (*PICTURES, ".npy", ".exr")
PNG_DEPTH_SCALE = 1 / 256  # metres in one code of a 16-bit depth PNG, as the KITTI depth benchmark has it
FEWEST_DENSE = 0.5  # share of pixels with a depth under which a depth file is a sparse scan, not a plane


def read_npy(path: Path) -> NDArray[Any]:
    """Array of a .npy file; nothing pickled is read.

    Raises
    ------
    InputError
        The file cannot be read, is truncated, or holds no numbers.
    """
    read_bytes(path)
    try:
        array = np.load(path, allow_pickle=False)
    except (ValueError, OSError, EOFError) as error:
        raise InputError(f"{path}: expected a NumPy array of numbers ({error})") from error
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "biuf":
        raise InputError(f"{path}: expected a NumPy array of numbers")
    return array


def _numbers(path: Path) -> NDArray[Any]:
    """Values as they are in the file: codes of a picture, numbers of an array or of an OpenEXR image."""
    suffix = path.suffix.lower()
    if suffix == ".npy":
        return np.squeeze(read_npy(path))
    if suffix == ".exr":
        return read_exr_plane(path)
    return read_png(path) if suffix == ".png" else read_rgb(path)


def _single(path: Path, values: NDArray[Any]) -> NDArray[Any]:
    if values.ndim == 2:
        return values
    if values.ndim == 3 and values.shape[2] == 3 and not (values != values[..., :1]).any():
        return np.asarray(values[..., 0])  # grey, spread to three channels
    raise InputError(f"{path}: expected one channel, (H, W), got {values.shape}")


def _unit(values: NDArray[Any]) -> NDArray[np.float32]:
    """Codes as fractions of the largest code; floats as they are."""
    if values.dtype.kind == "u":
        return (values / np.float32(np.iinfo(values.dtype).max)).astype(np.float32)
    return values.astype(np.float32)


def _colour(path: Path) -> Plane:
    values = _numbers(path)
    if values.ndim != 3:
        raise InputError(f"{path}: expected three channels, (H, W, 3), got {values.shape}")
    if values.dtype == np.uint8:
        return decode_srgb8(values)
    return srgb_to_linear(_unit(values)).astype(np.float32) if values.dtype.kind == "u" else _unit(values)


def _normal(path: Path) -> Plane:
    values = _numbers(path)
    if values.ndim != 3:
        raise InputError(f"{path}: expected three channels, (H, W, 3), got {values.shape}")
    n = _unit(values)
    if values.dtype.kind == "u":
        n = 2 * n - 1
    length = np.linalg.norm(n, axis=-1, keepdims=True)
    if not (np.abs(length - 1) < 0.1).all():  # beyond what 8 bits a component explain
        raise InputError(f"{path}: expected unit normals, got lengths {length.min():g} to {length.max():g}")
    return np.asarray(n / length, dtype=np.float32)


def _fraction(path: Path) -> Plane:
    return _unit(_single(path, _numbers(path)))


def _mask(path: Path) -> Plane:
    values = _single(path, _numbers(path))
    # A PNG marks with any code, 1 or 255; one half divides what a JPEG has blurred, and fractions.
    return np.asarray(values > 0 if path.suffix.lower() == ".png" else _unit(values) > 0.5)


def _instances(path: Path) -> Plane:
    values = _single(path, _numbers(path))
    if values.size and (values.min() < 0 or values.max() > INSTANCE_MAX or (values != np.floor(values)).any()):
        raise InputError(f"{path}: expected instance numbers within [0, {INSTANCE_MAX}]")
    return values.astype(np.int32)


READERS: dict[str, Callable[[Path], Plane]] = {
    "normal": _normal,
    "albedo": _colour,
    "roughness": _fraction,
    "metallic": _fraction,
    "emissive": _colour,
    "sky": _mask,
    "road": _mask,
    "vehicle": _instances,
    "street_light": _instances,
}


def read_depth(path: Path, scale: float | None) -> NDArray[np.float32]:
    """Depth [m] of a file, (H, W); 0 where the file has none (0, negative, NaN, infinite).

    Parameters
    ----------
    path
        .npy, .exr or .png.
    scale
        Metres in one unit of the file; by default 1/256 for a PNG and 1 for the others.
    """
    values = _single(path, _numbers(path))
    if scale is None:
        scale = PNG_DEPTH_SCALE if values.dtype.kind == "u" else 1.0
    with np.errstate(invalid="ignore", over="ignore"):
        depth = values.astype(np.float64) * scale
        depth[~np.isfinite(depth) | (depth <= 0)] = 0
    return np.minimum(depth, DEPTH_MAX).astype(np.float32)
