"""Timing properly: warmed up, repeated, the median and how far runs lie from it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


def _nothing() -> None:
    """What needs no preparation."""


@dataclass(frozen=True, kw_only=True)
class Timing:
    """Median, and fastest and slowest quarter [ms], of some runs."""

    median_ms: float
    low_ms: float
    high_ms: float
    runs: int


def seconds(run: Callable[[], object], count: int, prepare: Callable[[], object] = _nothing) -> list[float]:
    """Wall time of every run [s]; what prepares a run is not timed."""
    out = []
    for _ in range(count):
        prepare()
        start = time.perf_counter()
        run()
        out.append(time.perf_counter() - start)
    return out


def timing(took_s: list[float]) -> Timing:
    """Median and quartiles of wall times [s]."""
    low, median, high = (float(np.percentile(took_s, q)) * 1e3 for q in (25, 50, 75))
    return Timing(median_ms=median, low_ms=low, high_ms=high, runs=len(took_s))


def timed(run: Callable[[], object], *, runs: int, prepare: Callable[[], object] = _nothing) -> Timing:
    """Time a function that ends when its work is done, after a run that does not count."""
    seconds(run, 1, prepare)
    return timing(seconds(run, runs, prepare))
