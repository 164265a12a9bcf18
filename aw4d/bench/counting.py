"""What a pass moves and computes: bytes of its planes, and operations of its definition.

Bytes: every plane that a pass reads counts once, every plane that it writes once, in the device's types (float32,
masks of a byte, ids of four); what its stages keep for each other, its tables and its particles do not count.

Operations: those that the float64 reference does on floating-point numbers, counted while it runs. An addition, a
multiplication, a division, a root, a power and an exponential are one each, so a multiply-add is two, as in the
device's limit; comparisons, selects, minima and maxima, absolute values, roundings and conversions are none. A kernel
may need fewer, and computes lanes that the reference leaves out: the share of the limit says how the time taken
relates to the work that was asked for.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from aw4d.backend_numpy import NumpyBackend, NumpyPlanes
from aw4d.params import Params
from aw4d.passes import PASSES, held_as

_FREE = frozenset(
    {
        *("equal", "not_equal", "less", "less_equal", "greater", "greater_equal", "isfinite", "isnan", "isinf"),
        *("minimum", "maximum", "fmin", "fmax", "clip", "absolute", "fabs", "negative", "positive", "sign", "signbit"),
        *("floor", "ceil", "trunc", "rint", "copysign", "logical_and", "logical_or", "logical_not", "conjugate"),
    }
)


def moved_bytes(name: str, shape: tuple[int, int], at_hand: Collection[str]) -> int:
    """Bytes that a pass must read and write on a frame of (height, width) that has some planes already."""
    entry = PASSES[name]
    read = [plane for plane in entry.reads if plane not in entry.optional or plane in at_hand]
    total = 0
    for plane in (*read, *entry.writes):
        channels, dtype = held_as(plane)
        total += channels * np.dtype(dtype).itemsize
    return total * shape[0] * shape[1]


class _Counted(np.ndarray[Any, Any]):
    """An array whose arithmetic is counted, and that of everything computed from it."""

    total = 0.0

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, out: Any = None, **options: Any) -> Any:
        plain = [_plain(value) for value in inputs]
        if out is not None:
            options["out"] = tuple(_plain(value) for value in out)
        if isinstance(options.get("where"), np.ndarray):
            options["where"] = _plain(options["where"])
        result = getattr(ufunc, method)(*plain, **options)
        if ufunc.__name__ not in _FREE:
            _Counted.total += _operations(ufunc, method, plain, result)
        if out is not None:
            return out[0] if len(out) == 1 else out
        return tuple(map(_counted, result)) if isinstance(result, tuple) else _counted(result)

    def __array_function__(self, function: Any, types: Any, args: Any, options: Any) -> Any:
        if function is np.einsum:
            plain = [_plain(value) for value in args]
            _Counted.total += _einsum_operations(plain[0], plain[1:])
            return _counted(np.einsum(*plain, **options))
        result = super().__array_function__(function, types, args, options)
        if function is np.cross:
            _Counted.total += 3 * result.size
        if function is np.linalg.norm:
            _Counted.total += 2 * np.size(args[0])
        return _counted(result) if isinstance(result, np.ndarray) else result


class _CountedNumpy:
    """NumPy as the references see it while they are counted: arrays that it makes anew are counted, too."""

    _MAKERS = frozenset({"asarray", "array", "zeros", "ones", "full", "empty", "arange", "linspace", "indices"})

    def __getattr__(self, name: str) -> Any:
        found = getattr(np, name)
        return (lambda *args, **options: _counted(found(*args, **options))) if name in self._MAKERS else found


@contextmanager
def _counting() -> Iterator[None]:
    modules = [module for name, module in sys.modules.items() if name.startswith("reference_numpy.")]
    seen = [module for module in modules if getattr(module, "np", None) is np]
    for module in seen:
        module.np = _CountedNumpy()  # type: ignore[attr-defined]
    try:
        yield
    finally:
        for module in seen:
            module.np = np  # type: ignore[attr-defined]


def _plain(value: Any) -> Any:
    return value.view(np.ndarray) if isinstance(value, _Counted) else value


def _counted(value: Any) -> Any:
    array = np.asarray(value)
    return array.view(_Counted) if array.dtype.kind == "f" else value


def _operations(ufunc: np.ufunc, method: str, inputs: list[Any], result: Any) -> float:
    """Of one call: one a value that is computed, and a multiply-add two a product in `matmul`."""
    first = np.asarray(result[0] if isinstance(result, tuple) else result)
    if first.dtype.kind != "f":
        return 0
    if method in ("reduce", "accumulate", "reduceat"):
        return float(np.size(inputs[0]))
    if ufunc.__name__ in ("matmul", "matvec", "vecmat", "vecdot"):
        return 2.0 * first.size * np.shape(inputs[0])[-1]
    return float(first.size)


def _einsum_operations(subscripts: str, operands: list[Any]) -> float:
    """A product for every combination of indices and operand but the first, and its addition to the sum."""
    left = subscripts.split("->")[0].split(",")
    sizes: dict[str, int] = {}
    rest = 1
    for letters, operand in zip(left, operands, strict=True):
        shape = np.shape(operand)
        named = letters.replace("...", "").replace(" ", "")
        tail = shape[len(shape) - len(named) :]
        rest = max(rest, int(np.prod(shape[: len(shape) - len(named)])))
        sizes |= dict(zip(named, tail, strict=True))
    return float(rest * np.prod(list(sizes.values()))) * len(operands)


def operations(name: str, planes: NumpyPlanes, p: Params) -> float:
    """Operations of a pass on a frame in its present state, which stays as it is."""
    watched = {key: _counted(value) for key, value in planes.arrays.items()}
    given = {key: _counted(value) if np.ndim(value) else value for key, value in planes.arguments.items()}
    copy = NumpyPlanes(shape=planes.shape, arrays=watched, arguments=given)
    importlib.import_module(f"reference_numpy.{name}")
    _Counted.total = 0.0
    with _counting():
        NumpyBackend().run(name, copy, p)
    return _Counted.total
