"""Metrics of pairs of frames: pictures, depths, labels. Those of one kind share one reading of the videos."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from aw4d.evaluation.labels import label_pairs
from aw4d.evaluation.pairs import Pair, depth_pairs
from aw4d.evaluation.request import Found, Request, Watch
from aw4d.evaluation.stream import records
from eval.score import FrameMetric, pooled


def pictures(request: Request, conventions: Mapping[str, Any], watch: Watch) -> dict[str, Found]:
    """PSNR, SSIM and edge F1."""
    return _streamed(request.videos(), conventions, watch)


def depths(request: Request, conventions: Mapping[str, Any], watch: Watch) -> dict[str, Found]:
    """Depth si-RMSE."""
    ref, gen = request.both("depth", "depth, a folder, .npz or clip")
    sides = {"ref_disparity": request.ref_disparity, "gen_disparity": request.gen_disparity}
    told = {name: replace(convention, **sides) for name, convention in conventions.items()}
    return _streamed(depth_pairs(ref, gen, request.selection, request.pairs), told, watch)


def labels(request: Request, conventions: Mapping[str, Any], watch: Watch) -> dict[str, Found]:
    """Segmentation: pictures of labels, all videos in one confusion."""
    ref, gen = request.both("labels", "train ids, a folder of 8-bit PNG pictures")
    pairs = label_pairs(ref, gen, request.selection, request.pairs)
    return _streamed(pairs, conventions, watch, whole=True)


def _streamed(
    pairs: Sequence[Pair], metrics: Mapping[str, FrameMetric[Any]], watch: Watch, *, whole: bool = False
) -> dict[str, Found]:
    kept: dict[str, dict[str, list[Any]]] = {name: {} for name in metrics}
    for pair in pairs:
        read = records(watch(pair, f"{', '.join(metrics)}: {pair.name}", len(pair)), metrics)
        for name in metrics:
            kept[name][pair.name] = [record[name] for record in read]
    numbers = {pair.name: pair.gen_frames for pair in pairs}
    found = {}
    for name, metric in metrics.items():
        scores = {video: pooled(metric, made) for video, made in kept[name].items()}
        together = [record for made in kept[name].values() for record in made]
        all_videos = pooled(metric, together) if whole and len(pairs) > 1 else None
        found[name] = Found(scores=scores, whole=all_videos, numbers=numbers)
    return found
