"""Reading and writing whole files: one-line errors, writes that never leave half a file, names for resuming."""

from __future__ import annotations

import contextlib
import glob
import hashlib
import os
import shutil
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from aw4d.errors import InputError
from aw4d.exchange import put


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


def _beside(path: Path) -> Path:
    """A name beside `path` that tells who fills it."""
    return path.with_name(f".{path.name}.{os.uname().nodename}.{os.getpid()}.tmp")


def remove_left(path: Path) -> None:
    """Delete what processes of this machine that were killed have left beside `path`; living ones keep theirs."""
    for left in path.parent.glob(f".{glob.escape(path.name)}.{glob.escape(os.uname().nodename)}.*.tmp"):
        writer = left.name.split(".")[-2]
        if writer.isdecimal() and not _alive(int(writer)):
            remove(left)


def _alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:  # another user's
        return True
    return True


def remove(path: Path) -> None:
    """Delete a file or a folder as far as it can be deleted."""
    with contextlib.suppress(OSError):
        path.unlink(missing_ok=True)
    shutil.rmtree(path, ignore_errors=True)


@contextlib.contextmanager
def _filled(path: Path, place: Callable[[Path, Path], object]) -> Iterator[Path]:
    temporary = _beside(path)
    try:
        yield temporary
        place(temporary, path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from error
    finally:
        remove(temporary)


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A name beside `path` to write a file to; it takes the place of `path` when the block ends well, else it goes.

    Raises
    ------
    InputError
        The file cannot be written: no such folder, no permission, disk full.
    """
    with _filled(path, Path.replace) as temporary:
        yield temporary


@contextlib.contextmanager
def replacing_folder(path: Path) -> Iterator[Path]:
    """A folder beside `path` to fill; it takes the place of `path` when the block ends well, else it goes.

    Raises
    ------
    InputError
        The folder cannot be written: no such place, no permission, disk full.
    """
    with _filled(path, put) as temporary:
        temporary.mkdir(parents=True)
        yield temporary


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
