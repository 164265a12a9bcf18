"""Percentile of a whole clip's depth in one pass and constant memory: the depth that the sky is given."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from aw4d.errors import InputError

NEAREST, FARTHEST = 1e-3, 1e5  # [m] the range that a depth plane may hold
BINS = 9216  # each 0.2 % wide, so a bin's centre is within 0.1 % of every depth in it


class DepthPercentile:
    """Histogram of depth in logarithmic bins, filled frame by frame."""

    def __init__(self) -> None:
        self._counts: NDArray[np.int64] = np.zeros(BINS, dtype=np.int64)

    def add(self, depth: NDArray[np.float32], sky: NDArray[np.bool_]) -> None:
        """Count a frame's depth outside the sky.

        Parameters
        ----------
        depth
            (H, W) [m]; where the sky is, any value.
        sky
            (H, W) mask.

        Raises
        ------
        InputError
            The shapes differ, or a depth outside the sky is not within [1e-3, 1e5] m.
        """
        if depth.shape != sky.shape:
            raise InputError(f"sky: expected the shape of depth, {depth.shape}, got {sky.shape}")
        seen = np.asarray(depth[~sky], dtype=np.float64)
        bad = ~((seen >= NEAREST * (1 - 1e-6)) & (seen <= FARTHEST * (1 + 1e-6)))
        if bad.any():
            raise InputError(
                f"depth: expected metres within [{NEAREST:g}, {FARTHEST:g}] outside the sky, got {seen[bad][0]} "
                f"and {np.count_nonzero(bad) - 1} more such values"
            )
        place = np.log(seen / NEAREST) * (BINS / np.log(FARTHEST / NEAREST))
        index = np.clip(place.astype(np.int64), 0, BINS - 1)
        self._counts += np.bincount(index, minlength=BINS)

    def value(self, percentile: float = 99.0) -> float:
        """Depth [m] below which the given percentage lies, interpolated between ranks, within 0.1 %.

        Raises
        ------
        InputError
            No depth was added, or the percentile is not within [0, 100].
        """
        total = int(self._counts.sum())
        if not total:
            raise InputError("depth: expected a clip that shows something else than sky, got no depth outside the sky")
        if not 0 <= percentile <= 100:
            raise InputError(f"percentile: expected a value within [0, 100], got {percentile}")
        rank = percentile / 100 * (total - 1)
        low, high = self._at(int(np.floor(rank))), self._at(int(np.ceil(rank)))
        return float(low + (high - low) * (rank - np.floor(rank)))

    def _at(self, rank: int) -> float:
        """Centre of the bin that holds the depth of this rank [m]."""
        index = int(np.searchsorted(np.cumsum(self._counts), rank, side="right"))
        return float(NEAREST * (FARTHEST / NEAREST) ** ((index + 0.5) / BINS))
