"""Cosines of features: 1 for one direction, 0 for nothing in common."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from eval.errors import MetricError
from eval.values import Undefined, Value


def cosines(a: NDArray[Any], b: NDArray[Any]) -> tuple[Value, ...]:
    """a.b / (|a| |b|) of features (N, d), or of (N, d) and one (d,); undefined where a feature has no length.

    Of a feature and itself it is 1 exactly, to the last bit.

    >>> cosines(np.array([[3.0, 4.0], [4.0, -3.0], [0.0, 0.0]]), np.array([3.0, 4.0]))
    (1.0, 0.0, Undefined(reason='a feature of length 0'))

    Raises
    ------
    MetricError
        Shapes that do not fit, or a number that is not finite.
    """
    left, right = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    if left.ndim != 2 or right.shape not in (left.shape, left.shape[1:]):
        raise MetricError(f"features: expected (N, d) and (N, d) or (d,), got {left.shape} and {right.shape}")
    if not (np.isfinite(left).all() and np.isfinite(right).all()):
        raise MetricError("features: expected finite numbers, got NaN or infinity")
    left, right = (x / np.maximum(np.abs(x).max(axis=-1, keepdims=True), 1e-300) for x in (left, right))
    right = np.broadcast_to(right, left.shape)
    dots, lefts, rights = (np.einsum("nd,nd->n", x, y) for x, y in ((left, right), (left, left), (right, right)))
    return tuple(
        float(np.clip(dot / np.sqrt(length), -1, 1)) if length > 0 else Undefined("a feature of length 0")
        for dot, length in zip(dots, lefts * rights, strict=True)
    )
