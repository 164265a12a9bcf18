"""Intrinsics, poses and times that lie beside a folder of pictures."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aw4d.errors import InputError
from aw4d.io.files import read_text

Array = NDArray[np.float64]


def _json(path: Path) -> Any:
    try:
        return json.loads(read_text(path))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: expected JSON ({error})") from error


def _array(path: Path, value: Any, shape: tuple[int, ...]) -> Array:
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.empty(0)
    if array.shape != shape or not np.isfinite(array).all():
        raise InputError(f"{path}: expected {shape} finite numbers, got shape {array.shape}")
    return array


def read_intrinsics(folder: Path, width: int, height: int, focal_px: float | None, fov_deg: float | None) -> Array:
    """K, (3, 3) [px], of intrinsics.json, or else from the focal length [px] or the horizontal field of view [degrees].

    Raises
    ------
    InputError
        The file does not hold a matrix, or there is nothing to take K from.
    """
    path = folder / "intrinsics.json"
    if path.is_file():
        data = _json(path)
        if isinstance(data, dict) and "K" not in data:
            try:
                data = [[data["fx"], 0, data["cx"]], [0, data["fy"], data["cy"]], [0, 0, 1]]
            except KeyError as error:
                raise InputError(f"{path}: expected K, or fx, fy, cx and cy; {error} is not there") from error
        return _array(path, data["K"] if isinstance(data, dict) else data, (3, 3))
    if focal_px is None and fov_deg is not None:
        if not 1 <= fov_deg <= 170:
            raise InputError(f"fov_deg: expected 1 to 170 degrees, got {fov_deg}")
        focal_px = float(width / 2 / np.tan(np.deg2rad(fov_deg) / 2))
    if focal_px is None:
        raise InputError(f"{folder}: missing calibration: expected intrinsics.json, a focal length or a field of view")
    return np.array([[focal_px, 0, (width - 1) / 2], [0, focal_px, (height - 1) / 2], [0, 0, 1]])


def _table(path: Path, rows: int) -> Array:
    try:
        return np.loadtxt(read_text(path).splitlines(), ndmin=2)
    except ValueError as error:
        raise InputError(f"{path}: expected {rows} rows of numbers ({error})") from error


def read_poses(folder: Path, count: int) -> Array | None:
    """Camera-to-world matrices, (count, 4, 4), of poses.json or poses.txt; None where there is neither.

    Raises
    ------
    InputError
        The file does not hold that many matrices of 12 or 16 numbers.
    """
    path = folder / "poses.json"
    if path.is_file():
        return _array(path, _json(path), (count, 4, 4))
    path = folder / "poses.txt"
    if not path.is_file():
        return None
    table = _table(path, count)
    if table.shape == (count, 12):
        table = np.column_stack([table, np.tile([0.0, 0, 0, 1], (count, 1))])
    if table.shape != (count, 16):
        raise InputError(f"{path}: expected {count} rows of 12 or 16 numbers, got {table.shape}")
    return _array(path, table.reshape(-1, 4, 4), (count, 4, 4))


def read_times(folder: Path, count: int, fps: float) -> Array:
    """Seconds since the first frame, (count,), of times.txt, or else from frames a second.

    Raises
    ------
    InputError
        The file does not hold that many numbers, or the rate is out of range.
    """
    path = folder / "times.txt"
    if not path.is_file():
        if not 0 < fps <= 1000:
            raise InputError(f"fps: expected frames a second within (0, 1000], got {fps}")
        return np.arange(count) / fps
    times = _array(path, _table(path, count).ravel(), (count,))
    return times - times[0]
