"""Metrics of pairs of frames: pictures, depths, labels. Those of one kind share one reading of the videos."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from aw4d.evaluation.labels import label_pairs
from aw4d.evaluation.pairs import Pair, depth_pairs
from aw4d.evaluation.request import Found, Request, Watch
from aw4d.evaluation.stream import scores
from eval.score import FrameMetric, Score


def pictures(request: Request, conventions: Mapping[str, Any], watch: Watch) -> dict[str, Found]:
    """PSNR, SSIM and edge F1."""
    return _streamed(request.videos(), conventions, watch)


def depths(request: Request, conventions: Mapping[str, Any], watch: Watch) -> dict[str, Found]:
    """Depth si-RMSE."""
    ref, gen = request.both("depth", "depth")
    return _streamed(depth_pairs(ref, gen, request.selection, request.pairs), conventions, watch)


def labels(request: Request, conventions: Mapping[str, Any], watch: Watch) -> dict[str, Found]:
    """Segmentation: pictures of labels."""
    ref, gen = request.both("labels", "train ids as 8-bit PNG pictures")
    return _streamed(label_pairs(ref, gen, request.selection, request.pairs), conventions, watch)


def _streamed(pairs: Sequence[Pair], metrics: Mapping[str, FrameMetric[Any]], watch: Watch) -> dict[str, Found]:
    by_metric: dict[str, dict[str, Score]] = {name: {} for name in metrics}
    for pair in pairs:
        for name, score in scores(watch(pair, f"{', '.join(metrics)}: {pair.name}", len(pair)), metrics).items():
            by_metric[name][pair.name] = score
    return {name: Found(scores=found) for name, found in by_metric.items()}
