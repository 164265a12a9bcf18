"""Metrics of pairs of frames over a video that is read once, on both cores, in memory that does not grow."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

from numpy.typing import NDArray

from eval.score import FrameMetric, Score, pooled

Frames = tuple[NDArray[Any], NDArray[Any]]
WORKERS = 2


def records(frames: Iterable[Frames], metrics: Mapping[str, FrameMetric[Any]]) -> list[dict[str, Any]]:
    """What every metric keeps of every pair of frames, in order.

    Parameters
    ----------
    frames
        Pairs of frames in order, ref before gen; drawn as workers become free.
    metrics
        By name.

    Raises
    ------
    MetricError
        A pair of frames is not what a metric takes.
    """
    return list(_records(frames, metrics))


def scores(frames: Iterable[Frames], metrics: Mapping[str, FrameMetric[Any]]) -> dict[str, Score]:
    """Every metric of two videos, with its interval; see `records`."""
    read = records(frames, metrics)
    return {name: pooled(metric, [record[name] for record in read]) for name, metric in metrics.items()}


def _records(frames: Iterable[Frames], metrics: Mapping[str, FrameMetric[Any]]) -> Iterator[dict[str, Any]]:
    # Threads: OpenCV and NumPy let go of the interpreter's lock, and frames need not be copied to other processes.
    pool = ThreadPoolExecutor(WORKERS)
    pending: deque[Future[dict[str, Any]]] = deque()
    try:
        for ref, gen in frames:
            pending.append(pool.submit(_record, metrics, ref, gen))
            if len(pending) >= 2 * WORKERS:
                yield pending.popleft().result()
        while pending:
            yield pending.popleft().result()
    finally:
        pool.shutdown(cancel_futures=True)


def _record(metrics: Mapping[str, FrameMetric[Any]], ref: NDArray[Any], gen: NDArray[Any]) -> dict[str, Any]:
    return {name: metric.frame(ref, gen) for name, metric in metrics.items()}
