"""What a metric says of one video or one set, and how metrics of pairs of frames are run."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from eval.values import Undefined, Value, mean, percentiles

Record = TypeVar("Record")
Kept = TypeVar("Kept", contravariant=True)
RESAMPLES = 500  # of a video's frames: each is pooled anew
TOGETHER = 50  # of these: all at once they would take memory that grows with the video
NO_VALUE = mean([])


@dataclass(frozen=True, kw_only=True)
class Score:
    """One metric of one video or one set.

    Parameters
    ----------
    value
        The metric under its convention.
    frames
        The same by frame (or by pair, by box), where it has such parts.
    others
        Numbers that belong with it, by name: the same under other conventions, counts, parts.
    interval
        Ends of the 95 % interval of `value`, where the metric can say it.
    """

    value: Value
    frames: tuple[Value, ...] = ()
    others: Mapping[str, Value] = field(default_factory=dict)
    interval: tuple[float, float] | None = None


class Additive(Protocol[Kept]):
    """A metric that depends on what was kept of each frame through sums alone; a mean is a sum and a count."""

    def pool(self, records: Sequence[Kept]) -> Score:
        """The metric of a video from its frames' records, in order."""

    def summands(self, records: Sequence[Kept]) -> NDArray[np.float64]:
        """What is added up, a row a frame, (T, k)."""

    def of_sums(self, sums: NDArray[np.float64]) -> Value:
        """The metric, from the sums over the frames, (k,); `pool` has the same value."""


class FrameMetric(Additive[Record], Protocol[Record]):
    """A metric that takes two videos frame by frame: records of frames, made anywhere and in any order, are pooled."""

    def frame(self, ref: NDArray[Any], gen: NDArray[Any]) -> Record:
        """What is kept of one pair of frames: small, and picklable."""


def pooled(metric: Additive[Record], records: Sequence[Record], *, seed: int = 0) -> Score:
    """The metric of a video with its interval, from pooling its frames drawn anew with replacement. Efron 1979.

    A frame that is drawn n times counts n times in the sums: a draw costs no more than a product of matrices.
    """
    score = metric.pool(records)
    if len(records) < 2 or isinstance(score.value, Undefined) or not math.isfinite(score.value):
        return score
    rng, summands = np.random.default_rng(seed), metric.summands(records)
    times = np.empty((TOGETHER, len(records)))
    values: list[Value] = []
    for _ in range(0, RESAMPLES, TOGETHER):
        for row in times:
            row[:] = np.bincount(rng.integers(0, len(row), len(row)), minlength=len(row))
        values += [metric.of_sums(sums) for sums in times @ summands]
    return replace(score, interval=percentiles(values))


def summands_of_mean(values: Sequence[Value]) -> NDArray[np.float64]:
    """Each value and a 1, (T, 2); twice 0 where it is undefined.

    >>> summands_of_mean([0.5, Undefined("no edges")]).tolist()
    [[0.5, 1.0], [0.0, 0.0]]
    """
    return np.array([(0.0, 0.0) if isinstance(value, Undefined) else (value, 1.0) for value in values]).reshape(-1, 2)


def mean_of_sums(sums: NDArray[np.float64]) -> Value:
    """The mean, from the sums of `summands_of_mean`.

    >>> mean_of_sums(np.array([3.0, 2.0]))
    1.5
    """
    return float(sums[0] / sums[1]) if sums[1] else NO_VALUE


def score(metric: FrameMetric[Record], ref: Iterable[NDArray[Any]], gen: Iterable[NDArray[Any]]) -> Score:
    """The metric of two videos, given as frames that pair one to one; one pair is held at a time.

    Raises
    ------
    ValueError
        One video is longer than the other.
    """
    return pooled(metric, [metric.frame(r, g) for r, g in zip(ref, gen, strict=True)])
