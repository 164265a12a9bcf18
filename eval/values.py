"""Numbers that may not exist: what is undefined says why and is counted, it is neither dropped nor called 0."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

RESAMPLES = 2000
CONFIDENCE = 0.95


@dataclass(frozen=True)
class Undefined:
    """In place of a number that does not exist; `reason` is a short clause, the same words for the same cause."""

    reason: str


Value = float | Undefined  # a float is never NaN; it may be infinite, as the PSNR of equal pictures is


def mean(values: Sequence[Value]) -> Value:
    """Mean of the values that exist.

    >>> mean([1.0, Undefined("no edges"), 3.0])
    2.0
    >>> mean([Undefined("no edges")])
    Undefined(reason='no frame has a value')
    """
    numbers = defined(values)
    return math.fsum(numbers) / len(numbers) if numbers else Undefined("no frame has a value")


def defined(values: Sequence[Value]) -> list[float]:
    """The values that exist, in order."""
    return [value for value in values if not isinstance(value, Undefined)]


def undefined(values: Sequence[Value]) -> dict[str, int]:
    """How many values do not exist, by reason.

    >>> undefined([1.0, Undefined("no edges"), Undefined("no edges")])
    {'no edges': 2}
    """
    return dict(Counter(value.reason for value in values if isinstance(value, Undefined)))


def interval(values: Sequence[Value], *, seed: int = 0) -> tuple[float, float] | None:
    """Bootstrap interval of the mean at 95 %; None with fewer than two finite values. Efron 1979.

    The same values and seed give the same interval.
    """
    numbers = np.array([value for value in defined(values) if math.isfinite(value)])
    if len(numbers) < 2:
        return None
    picks = np.random.default_rng(seed).integers(0, len(numbers), (RESAMPLES, len(numbers)))
    return percentiles(numbers[picks].mean(axis=1).tolist())


def percentiles(values: Sequence[Value]) -> tuple[float, float] | None:
    """Ends of the middle 95 % of the finite values; None with fewer than two."""
    numbers = [value for value in defined(values) if math.isfinite(value)]
    if len(numbers) < 2:
        return None
    tail = 100 * (1 - CONFIDENCE) / 2
    low, high = np.percentile(numbers, [tail, 100 - tail])
    return float(low), float(high)
