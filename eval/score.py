"""What a metric says of one video or one set, and how metrics of pairs of frames are run."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from eval.values import Undefined, Value, percentiles

Record = TypeVar("Record")
Kept = TypeVar("Kept", contravariant=True)
RESAMPLES = 500  # of a video's frames: each is pooled anew


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


class Pooling(Protocol[Kept]):
    """A metric of what was kept of each frame of a video."""

    def pool(self, records: Sequence[Kept]) -> Score:
        """The metric of a video from its frames' records, in order."""


class FrameMetric(Pooling[Record], Protocol[Record]):
    """A metric that takes two videos frame by frame: records of frames, made anywhere and in any order, are pooled."""

    def frame(self, ref: NDArray[Any], gen: NDArray[Any]) -> Record:
        """What is kept of one pair of frames: small, and picklable."""


def pooled(metric: Pooling[Record], records: Sequence[Record], *, seed: int = 0) -> Score:
    """The metric of a video with its interval, from pooling its frames drawn anew with replacement. Efron 1979."""
    score = metric.pool(records)
    if len(records) < 2 or isinstance(score.value, Undefined) or not math.isfinite(score.value):
        return score
    picks = np.random.default_rng(seed).integers(0, len(records), (RESAMPLES, len(records)))
    values = [metric.pool([records[i] for i in pick]).value for pick in picks]
    return replace(score, interval=percentiles(values))


def score(metric: FrameMetric[Record], ref: Iterable[NDArray[Any]], gen: Iterable[NDArray[Any]]) -> Score:
    """The metric of two videos, given as frames that pair one to one; one pair is held at a time.

    Raises
    ------
    ValueError
        One video is longer than the other.
    """
    return pooled(metric, [metric.frame(r, g) for r, g in zip(ref, gen, strict=True)])
