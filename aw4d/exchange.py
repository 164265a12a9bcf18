"""Giving a file or a folder a name that another one has: at every moment one of both bears it, whole."""

from __future__ import annotations

import ctypes
import errno
import os
from pathlib import Path

_AT_FDCWD, _RENAME_EXCHANGE = -100, 2  # of linux/fcntl.h and linux/fs.h


def exchanged(new: Path, path: Path) -> bool:
    """Whether the two names, which both exist, have changed places; False where the file system cannot do that."""
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.renameat2(_AT_FDCWD, os.fsencode(new), _AT_FDCWD, os.fsencode(path), _RENAME_EXCHANGE) == 0:
        return True
    code = ctypes.get_errno()
    if code in (errno.EINVAL, errno.ENOSYS, errno.ENOTSUP):
        return False
    raise OSError(code, os.strerror(code))


def put(new: Path, path: Path) -> None:
    """Give `new` the name `path`. A folder that has it gets the name `new`; a file that has it is gone.

    Where the file system cannot exchange two names, a folder named `path` is away for a moment.
    """
    if not path.is_dir():
        new.replace(path)
    elif not exchanged(new, path):
        aside = new.with_name(f"{new.name}.old")
        path.rename(aside)
        new.rename(path)
        aside.rename(new)
