"""Results that are slow to make, kept on disk from run to run.

A cache that cannot be read or written costs time and nothing else: what is damaged is made anew, what finds no room is
not kept.
"""

from __future__ import annotations

import contextlib
import hashlib
import inspect
import io
import logging
import os
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eval.folders import user_folder

log = logging.getLogger("aw4d")
Arrays = dict[str, NDArray[Any]]

MOST = 64  # files of a kind; those that were not used for longest go first
CHECKSUM = hashlib.sha256().digest_size  # bytes before what is held
LITTER_S = 3600.0  # after which an unfinished file has been left by a run that was killed


def folder() -> Path:
    """Where the files lie: beside the features that an evaluation keeps."""
    return user_folder() / "edit"


def source_of(*modules: ModuleType) -> str:
    """The text of modules, for keys: what other code has made is not taken."""
    return "\0".join(map(inspect.getsource, modules))


def kept(kind: str, key: Sequence[object], make: Callable[[], Arrays]) -> Arrays:
    """What `make` gives, bit by bit; from disk where a run before has left it under the same key.

    Parameters
    ----------
    kind
        What it is; the file's name starts with it.
    key
        All that the result follows from: arrays, texts, numbers, the source of what makes it.
    make
        Gives arrays by name.
    """
    found = read(kind, key)
    if found is None:
        found = make()
        write(kind, key, found)
    return found


def read(kind: str, key: Sequence[object]) -> Arrays | None:
    """Arrays by name, or None where there are none or the file is damaged."""
    path = _path(kind, key)
    try:
        data = path.read_bytes()
        if _checksum(data[CHECKSUM:]) != data[:CHECKSUM]:  # a .npz alone may lose an array and not tell
            raise ValueError("the checksum does not match")
        with np.load(io.BytesIO(data[CHECKSUM:]), allow_pickle=False) as held:
            found = {name: held[name] for name in held.files}
    except FileNotFoundError:
        return None
    except Exception as error:  # a damaged file fails in whichever layer of it meets the damage first
        log.debug("%s: made anew (%s)", path, error)
        return None
    with contextlib.suppress(OSError):
        os.utime(path)
    return found


def write(kind: str, key: Sequence[object], arrays: Arrays) -> None:
    """Keep arrays by name; a reader finds all of the file or none. Where that cannot be, nothing happens."""
    path = _path(kind, key)
    data = io.BytesIO()
    np.savez(data, allow_pickle=False, **arrays)
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(prefix=f".{kind}-", suffix=".tmp", dir=path.parent)
        try:
            with open(handle, "wb") as file:
                file.write(_checksum(data.getbuffer()) + data.getvalue())
            Path(temporary).replace(path)
        finally:
            Path(temporary).unlink(missing_ok=True)
        _tidy(path.parent, kind)
    except OSError as error:
        log.debug("%s: not kept (%s)", path, error)


def _checksum(data: bytes | memoryview) -> bytes:
    return hashlib.sha256(data).digest()


def _path(kind: str, key: Sequence[object]) -> Path:
    digest = hashlib.sha256(np.__version__.encode())
    for part in key:
        text = repr((part.dtype.str, part.shape) if isinstance(part, np.ndarray) else part).encode()
        digest.update(len(text).to_bytes(8, "little") + text)
        if isinstance(part, np.ndarray):
            digest.update(part.tobytes())
    return folder() / f"{kind}-{digest.hexdigest()[:32]}.aw4d"


def _tidy(where: Path, kind: str) -> None:
    """Remove what is too many, and what killed runs have left."""
    late = time.time() - LITTER_S
    _remove(path for path, used in _used(where.glob(f".{kind}-*.tmp")) if used < late)
    by_use = sorted(_used(where.glob(f"{kind}-*.aw4d")), key=lambda held: held[1], reverse=True)
    _remove(path for path, _ in by_use[MOST:])


def _used(paths: Iterable[Path]) -> list[tuple[Path, float]]:
    """Files with the time of their last use; another run may have removed some."""
    found = []
    for path in paths:
        with contextlib.suppress(OSError):
            found.append((path, path.stat().st_mtime))
    return found


def _remove(paths: Iterable[Path]) -> None:
    for path in paths:
        path.unlink(missing_ok=True)
