"""What all models share: the file of weights, PyTorch where it is installed, pictures in batches."""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from types import ModuleType
from typing import TypeVar

from eval.errors import MetricError

Item = TypeVar("Item")


def module(name: str) -> ModuleType:
    """A module of the extra `metrics`.

    Raises
    ------
    MetricError
        It is not installed, or does not work.
    """
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        raise MetricError(f"{error.name} is not installed: pip install 'autoweather4d[metrics]'") from error
    except (ImportError, OSError, RuntimeError) as error:  # a torchvision of another torch ends in RuntimeError
        raise MetricError(f"{name} is installed, but does not import: {error}") from error


def found(path: Path, whence: str) -> Path:
    """The file of weights.

    Raises
    ------
    MetricError
        There is none; the message says where the weights come from. Nothing is ever downloaded.
    """
    if not path.is_file():
        raise MetricError(f"weights {path}: expected a file, and there is none. {whence}")
    return path


def device() -> str:
    """The name of a GPU of PyTorch's, or "cpu"."""
    return "cuda" if module("torch").cuda.is_available() else "cpu"


def batches(items: Iterable[Item], size: int) -> Iterator[list[Item]]:
    """Items in lists of `size`, the last may be shorter.

    >>> list(batches("abc", 2))
    [['a', 'b'], ['c']]
    """
    rest = iter(items)
    while batch := list(islice(rest, size)):
        yield batch
