"""Metrics that know the scene: flicker, shadow and visibility, with depth and poses of the clip that was edited."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from aw4d.clip import Clip
from aw4d.errors import InputError
from aw4d.evaluation.pairs import Pair
from aw4d.evaluation.request import Found, Request, Watch
from aw4d.evaluation.videos import sidecar_of
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


class Kind(NamedTuple):
    """What a metric keeps of a moment and the one before it, how it pools that, and what stands beside its score."""

    record: Callable[[Any, Moment, Moment | None], list[Any]]
    pool: Callable[[Any, Sequence[Any]], Score]
    beside: Callable[[Clip, Pair], dict[str, Value]]


def scenes(request: Request, conventions: Mapping[str, Any], watch: Watch) -> dict[str, Found]:
    """Flicker, shadow and visibility, from one reading of the videos."""
    pairs = request.videos()
    scores: dict[str, dict[str, Score]] = {name: {} for name in conventions}
    numbers: dict[str, dict[str, Sequence[int]]] = {name: {} for name in conventions}
    for pair in pairs:
        clip = scene_of(request, pair)
        kept: dict[str, list[Any]] = {name: [] for name in conventions}
        before: Moment | None = None
        for now in _moments(clip, pair, watch, ", ".join(conventions)):
            for name, metric in conventions.items():
                kept[name] += KINDS[name].record(metric, now, before)
            before = now
        for name, metric in conventions.items():
            score = KINDS[name].pool(metric, kept[name])
            beside = KINDS[name].beside(clip, pair)
            scores[name][pair.name] = replace(score, others={**score.others, **beside})
            numbers[name][pair.name] = pair.gen_frames[len(pair) - len(kept[name]) :]
    return {name: Found(scores=scores[name], numbers=numbers[name]) for name in conventions}


def scene_of(request: Request, pair: Pair) -> Clip:
    """The clip of a pair's scene, which its reference must be a video of.

    Raises
    ------
    InputError
        The reference has frames or a size that the clip has not.
    """
    clip = request.scene(pair)
    if pair.ref_frames and pair.ref_frames[-1] >= len(clip):
        got = f"frame {pair.ref_frames[-1]} of {pair.ref.path}"
        raise InputError(f"{clip.path}: expected a clip of the whole reference, got {len(clip)} frames and {got}")
    if (pair.ref.height, pair.ref.width) != (clip.info.height, clip.info.width):
        got = f"{pair.ref.width}x{pair.ref.height} in {pair.ref.path}"
        raise InputError(f"{clip.path}: expected a reference of {clip.info.width}x{clip.info.height}, got {got}")
    return clip


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


def _stillness(clip: Clip, pair: Pair) -> dict[str, Value]:
    views = (_view(clip, index)[0] for index in pair.ref_frames)
    return {"variance of what is still": static_variance(pair.gen.frames(pair.gen_frames), views).value}


def _shadow(metric: Any, now: Moment, before: Moment | None) -> list[Any]:
    return [metric.frame(now.ref, now.gen, borders(now.ref, now.road, now.view))]


def _visibility(metric: Any, now: Moment, before: Moment | None) -> list[Any]:
    return [metric.frame(now.gen, now.view)]


def parameter(path: Path) -> Value:
    """Visibility [m] of the fog, haze included, that an edit's sidecar tells."""
    sidecar = sidecar_of(path)
    with contextlib.suppress(KeyError, TypeError, ValueError):
        if "fog" not in sidecar["passes"]:
            return Undefined("the edit has no fog")
        fog = sidecar["settings"]["fog"]
        return sigma_to_visibility(float(fog["alpha"]) * (float(fog["sigma_s"]) + float(fog["sigma_a"])))
    return Undefined("no sidecar of an edit")


KINDS = {
    "flicker": Kind(_flicker, pooled, _stillness),
    "shadow": Kind(_shadow, pooled, lambda clip, pair: {}),
    # The fit says its own interval; fitting 500 times takes a minute.
    "visibility": Kind(
        _visibility, lambda metric, kept: metric.pool(kept), lambda clip, pair: {"parameter": parameter(pair.gen.path)}
    ),
}
