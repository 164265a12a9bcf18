"""Reading and writing whole files: one-line errors, writes that never leave half a file, names for resuming."""

from __future__ import annotations

import contextlib
import hashlib
import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from aw4d.errors import InputError


def read_bytes(path: Path) -> bytes:
    """Content of a file.

    Raises
    ------
    InputError
        The file is not there, cannot be read, or is empty.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from error
    if not data:
        raise InputError(f"{path}: the file is empty")
    return data


def read_text(path: Path) -> str:
    """Text of a UTF-8 file.

    Raises
    ------
    InputError
        The file is not there, cannot be read, is empty, or is no text.
    """
    try:
        return read_bytes(path).decode("utf-8-sig")  # spreadsheets put a mark before the text
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: expected a text file, got bytes that are not UTF-8") from error


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A name beside `path` to write to; it takes the place of `path` when the block ends well, else it is deleted.

    Raises
    ------
    InputError
        The file cannot be written: no such folder, no permission, disk full.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        yield temporary
        temporary.replace(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


def listed(folder: Path, suffixes: tuple[str, ...]) -> list[Path]:
    """Files of a folder with one of the suffixes (lower case), by name; empty where there is no such folder.

    Raises
    ------
    InputError
        The folder is there but cannot be read.
    """
    if not folder.is_dir():
        return []
    try:
        found = [path for path in folder.iterdir() if path.suffix.lower() in suffixes and not path.name.startswith(".")]
    except OSError as error:
        raise InputError(f"{folder}: cannot be read ({error.strerror or error})") from error
    return sorted(found)


def fingerprint(paths: Iterable[Path], *settings: object) -> str:
    """Names files (by name, size and time of change) and settings, so that a changed source is not resumed."""
    digest = hashlib.sha256(repr(settings).encode())
    for path in paths:
        stat = path.stat()
        digest.update(repr((path.name, stat.st_size, stat.st_mtime_ns)).encode())
    return digest.hexdigest()
