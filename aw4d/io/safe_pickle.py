"""Reads pickles of plain containers and NumPy values, and refuses everything else: a pickle is a program."""

from __future__ import annotations

import io
import pickle
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from aw4d.errors import InputError
from aw4d.io.files import read_bytes


def _latin1(text: str, encoding: str) -> bytes:
    # How Python 2 pickled bytes; any other codec is none of a data file's business.
    if encoding != "latin1":
        raise pickle.UnpicklingError(f"codec {encoding}")
    return text.encode("latin1")


# NumPy's own makers of arrays and scalars, asked from NumPy since their module was renamed in version 2.
_ARRAY: Any = np.zeros(1).__reduce__()[0]
_SCALAR: Any = np.float64(0).__reduce__()[0]
_BUFFER: Any = np.zeros(1).__reduce_ex__(5)[0]
_ADMITTED: dict[tuple[str, str], Callable[..., Any]] = {
    ("builtins", "set"): set,
    ("builtins", "frozenset"): frozenset,
    ("builtins", "bytearray"): bytearray,
    ("collections", "OrderedDict"): OrderedDict,
    ("_codecs", "encode"): _latin1,
    ("numpy", "dtype"): np.dtype,
    ("numpy", "ndarray"): np.ndarray,
    ("numpy.core.multiarray", "_reconstruct"): _ARRAY,
    ("numpy.core.multiarray", "scalar"): _SCALAR,
    ("numpy.core.numeric", "_frombuffer"): _BUFFER,
    ("numpy._core.multiarray", "_reconstruct"): _ARRAY,
    ("numpy._core.multiarray", "scalar"): _SCALAR,
    ("numpy._core.numeric", "_frombuffer"): _BUFFER,
}


class _Unpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        try:
            return _ADMITTED[module.replace("__builtin__", "builtins"), name]  # Python 2's name
        except KeyError:
            raise pickle.UnpicklingError(f"{module}.{name} is not plain data") from None


def read_plain_pickle(path: Path) -> Any:
    """Content of a pickle that holds numbers, text, containers and NumPy values only; nothing in it is run.

    Raises
    ------
    InputError
        The file cannot be read, is truncated, or names anything else.
    """
    data = read_bytes(path)
    try:
        return _Unpickler(io.BytesIO(data)).load()
    except Exception as error:  # a damaged pickle fails in any way at all
        raise InputError(f"{path}: expected a pickle of plain data ({error})") from error
