"""Metrics that know the scene: flicker, shadow and visibility, with depth and poses of the clip that was edited."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from aw4d.clip import Clip
from aw4d.evaluation.pairs import Pair
from aw4d.evaluation.request import Found, Request, Watch
from aw4d.output import sidecar_path
from eval.flicker import static_variance
from eval.score import Score, pooled
from eval.shadow import borders
from eval.values import Undefined, Value
from eval.view import View
from eval.visibility import sigma_to_visibility

PLANES = ["depth", "sky", "vehicle", "road"]


class Moment(NamedTuple):
    """One frame before and after the edit, and what is known of the scene in it."""

    ref: NDArray[np.uint8]
    gen: NDArray[np.uint8]
    view: View
    road: NDArray[np.bool_]


def scenes(request: Request, conventions: Mapping[str, Any], watch: Watch) -> dict[str, Found]:
    """Flicker, shadow and visibility, from one reading of the videos."""
    clip = request.scene()
    by_metric: dict[str, dict[str, Score]] = {name: {} for name in conventions}
    for pair in request.videos():
        records: dict[str, list[Any]] = {name: [] for name in conventions}
        before: Moment | None = None
        for now in _moments(clip, pair, watch, ", ".join(conventions)):
            for name, metric in conventions.items():
                records[name] += _RECORDS[name](metric, now, before)
            before = now
        for name, metric in conventions.items():
            score = metric.pool(records[name]) if name == "visibility" else pooled(metric, records[name])
            by_metric[name][pair.name] = replace(score, others={**score.others, **_beside(name, clip, pair)})
    return {name: Found(scores=scores) for name, scores in by_metric.items()}


def _moments(clip: Clip, pair: Pair, watch: Watch, what: str) -> Iterator[Moment]:
    watched = watch(pair, f"{what}: {pair.name}", len(pair))
    for index, (ref, gen) in zip(pair.ref_frames, watched, strict=True):
        view, road = _view(clip, index)
        yield Moment(ref, gen, view, road)


def _view(clip: Clip, index: int) -> tuple[View, NDArray[np.bool_]]:
    """What a clip knows of a frame; every vehicle may move."""
    frame, info = clip.frame(index, PLANES), clip.info
    view = View(
        depth=frame["depth"],
        K=info.K[index],
        sky=frame["sky"],
        moving=frame["vehicle"] > 0,
        camera_to_world=info.camera_to_world[index],
    )
    return view, frame["road"]


def _flicker(metric: Any, now: Moment, before: Moment | None) -> list[Any]:
    if before is None:
        return []
    return [metric.frame((before.ref, now.ref), (before.gen, now.gen), (before.view, now.view))]


def _shadow(metric: Any, now: Moment, before: Moment | None) -> list[Any]:
    return [metric.frame(now.ref, now.gen, borders(now.ref, now.road, now.view))]


def _visibility(metric: Any, now: Moment, before: Moment | None) -> list[Any]:
    return [metric.frame(now.gen, now.view)]


_RECORDS = {"flicker": _flicker, "shadow": _shadow, "visibility": _visibility}


def _beside(name: str, clip: Clip, pair: Pair) -> dict[str, Value]:
    """What stands beside a score: how still what stands still is; the visibility that the edit was made with."""
    if name == "flicker":
        pictures = pair.gen.frames(pair.gen_frames)
        return {
            "variance of what is still": static_variance(pictures, (_view(clip, i)[0] for i in pair.ref_frames)).value
        }
    return {"parameter": parameter(pair.gen.path)} if name == "visibility" else {}


def parameter(path: Path) -> Value:
    """Visibility [m] of the fog, haze included, that an edit's sidecar tells."""
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
        sidecar = json.loads(sidecar_path(path).read_text(encoding="utf-8"))
        if "fog" not in sidecar["passes"]:
            return Undefined("the edit has no fog")
        fog = sidecar["settings"]["fog"]
        return sigma_to_visibility(float(fog["alpha"]) * (float(fog["sigma_s"]) + float(fog["sigma_a"])))
    return Undefined("no sidecar of an edit")
