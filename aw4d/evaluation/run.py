"""Which metrics there are, and how those that were asked for are run on what was given."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from aw4d.errors import InputError
from aw4d.evaluation import on_boxes, on_files, on_frames, on_models, on_scenes
from aw4d.evaluation.request import MissingInputError, Request, Run, Watch
from aw4d.evaluation.result import Result
from aw4d.evaluation.videos import is_clip
from eval import (
    box_iou,
    clip_score,
    dover,
    edge_f1,
    flicker,
    fvd,
    identity,
    psnr,
    seg,
    shadow,
    si_rmse,
    ssim,
    visibility,
)
from eval.errors import MetricError, MissingError

ALL = "all"


@dataclass(frozen=True, kw_only=True)
class Metric:
    """One metric as the command line has it.

    Parameters
    ----------
    run
        What computes it; metrics of one `run` are computed together, from one reading of the videos.
    presets
        Conventions by name, None for one without parameters; the first is the default.
    unit, better
        Unit, "1" for none; "higher", "lower" or "neither".
    sides
        What `--ref` and `--gen` stand for where this metric alone is asked for: "depth", "boxes" or "labels".
    averaged
        Whether a mean over what it scores says anything.
    """

    run: Run
    presets: Mapping[str, Any]
    unit: str = "1"
    better: str = "higher"
    sides: str | None = None
    averaged: bool = True


METRICS: dict[str, Metric] = {
    "psnr": Metric(run=on_frames.pictures, presets=psnr.PRESETS, unit="dB"),
    "ssim": Metric(run=on_frames.pictures, presets=ssim.PRESETS),
    "edge-f1": Metric(run=on_frames.pictures, presets=edge_f1.PRESETS),
    "si-rmse": Metric(run=on_frames.depths, presets=si_rmse.PRESETS, better="lower", sides="depth"),
    "seg": Metric(run=on_frames.labels, presets=seg.PRESETS, sides="labels"),
    "iou": Metric(run=on_boxes.boxes, presets=box_iou.PRESETS, sides="boxes"),
    "flicker": Metric(run=on_scenes.scenes, presets=flicker.PRESETS, unit="codes", better="lower"),
    "shadow": Metric(run=on_scenes.scenes, presets=shadow.PRESETS, better="lower"),
    "visibility": Metric(run=on_scenes.scenes, presets=visibility.PRESETS, unit="m", better="neither"),
    "clip": Metric(run=on_models.clip, presets=clip_score.PRESETS),
    "identity": Metric(run=on_models.identity, presets=identity.PRESETS),
    "fvd": Metric(run=on_models.fvd_of_sets, presets=fvd.PRESETS, better="lower"),
    "dover": Metric(run=on_files.dover, presets=dover.PRESETS),
    "2afc": Metric(run=on_files.choices, presets={"win rate": None}, averaged=False),
}


class Findings(NamedTuple):
    """What was found; by metric what was lacking for it, and what went wrong with it."""

    results: list[Result]
    skipped: dict[str, str]
    failed: dict[str, str]


def evaluate(
    name: str, request: Request, *, preset: str | None = None, watch: Watch = lambda items, what, count: items
) -> Findings:
    """One metric, or with "all" every metric that the request has the inputs of.

    Parameters
    ----------
    name
        Of a metric, or "all".
    request
        What is measured.
    preset
        Convention; of "all" each metric takes it if it has it, else its default.
    watch
        Sees items on their way, to show progress.

    Raises
    ------
    InputError, MetricError
        The metric or the convention is unknown, there is nothing to measure, or the one metric lacks an input or has
        a wrong one; of "all", metrics fail each by itself.
    """
    names = list(METRICS) if name == ALL else [name]
    if name != ALL and name not in METRICS:
        raise InputError(f"metric: expected {', '.join(METRICS)} or {ALL}, got {name!r}")
    chosen = {one: _convention(one, preset, strict=name != ALL) for one in names}
    request = _scene_as_reference(request) if name == ALL else _sides(request, METRICS[name].sides)
    found = Findings([], {}, {})
    for run in dict.fromkeys(METRICS[one].run for one in names):
        together = {one: preset_name for one, preset_name in chosen.items() if METRICS[one].run is run}
        try:
            found.results.extend(_run(run, together, request, watch))
        except (MissingInputError, MissingError) as lacking:
            if name != ALL:
                raise InputError(f"{name} needs {lacking}") from None
            found.skipped.update(dict.fromkeys(together, f"needs {lacking}"))
        except (InputError, MetricError) as error:
            if name != ALL:
                raise
            found.failed.update(dict.fromkeys(together, str(error)))
    if not found.results and not found.failed:
        raise InputError(f"nothing to measure: every metric lacks an input (psnr {found.skipped['psnr']})")
    return found


def _convention(name: str, preset: str | None, *, strict: bool) -> str:
    presets = METRICS[name].presets
    if preset in presets:
        return str(preset)
    if preset is not None and (strict or not any(preset in metric.presets for metric in METRICS.values())):
        known = presets if strict else dict.fromkeys(one for metric in METRICS.values() for one in metric.presets)
        raise InputError(f"--preset: expected {', '.join(known)}, got {preset!r}")
    return next(iter(presets))


def _sides(request: Request, kind: str | None) -> Request:
    """Of one metric alone, --ref and --gen are what it compares."""
    if kind is None:
        return request
    given = {f"{side}_{kind}": getattr(request, f"{side}_{kind}") or getattr(request, side) for side in ("ref", "gen")}
    return dataclasses.replace(request, **given)


def _scene_as_reference(request: Request) -> Request:
    """Of all metrics, a clip in `ref` is the reference for depth and boxes too."""
    if request.ref is None or not is_clip(request.ref):
        return request
    depth, boxes = request.ref_depth or request.ref, request.ref_boxes or request.ref
    return dataclasses.replace(request, ref_depth=depth, ref_boxes=boxes)


def _run(run: Run, chosen: Mapping[str, str], request: Request, watch: Watch) -> Sequence[Result]:
    conventions = {name: METRICS[name].presets[preset] for name, preset in chosen.items()}
    start = time.perf_counter()
    found = run(request, conventions, watch)
    seconds = time.perf_counter() - start
    return [
        Result(
            metric=name,
            unit=METRICS[name].unit,
            better=METRICS[name].better,
            convention=found[name].convention or chosen[name],
            settings=_settings(conventions[name]) if found[name].convention is None else {},
            scores=found[name].scores,
            whole=found[name].whole,
            averaged=METRICS[name].averaged,
            numbers=found[name].numbers,
            weights=found[name].weights,
            seconds=seconds,
        )
        for name in chosen
    ]


def _settings(convention: Any) -> dict[str, Any]:
    return {} if convention is None else dataclasses.asdict(convention)
