"""Names of contents: what was hashed to one name is the same to the last bit."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

CHUNK = 1 << 20


def of_file(path: Path) -> str:
    """SHA-256 of a file's bytes, in hexadecimal.

    Raises
    ------
    OSError
        The file cannot be read.
    """
    return of_files([path])


def of_files(paths: Iterable[Path]) -> str:
    """SHA-256 of files, in the order given; of one file it is the hash that `sha256sum` prints."""
    found = hashlib.sha256()
    for path in paths:
        with path.open("rb") as file:
            while chunk := file.read(CHUNK):
                found.update(chunk)
    return found.hexdigest()


def of_frames(frames: Iterable[NDArray[Any]]) -> str:
    """SHA-256 of arrays in order: their shapes, types and values; one is held at a time.

    >>> of_frames([np.zeros((2, 3))]) == of_frames([np.zeros((3, 2))])
    False
    """
    found = hashlib.sha256()
    for frame in frames:
        found.update(f"{frame.dtype.str}{frame.shape}".encode())
        found.update(np.ascontiguousarray(frame).data)
    return found.hexdigest()


def of_settings(settings: Mapping[str, Any]) -> str:
    """SHA-256 of settings that JSON can hold; the order of their names does not matter.

    >>> of_settings({"stride": 1, "frames": 16}) == of_settings({"frames": 16, "stride": 1})
    True
    """
    return hashlib.sha256(json.dumps(settings, sort_keys=True).encode()).hexdigest()
