"""The plots of a run: error against time with the front, cost curves, times of passes, an edit's stages."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from aw4d.bench.bars import best_rows
from aw4d.bench.found import Found
from aw4d.bench.fronts import Point, front
from aw4d.bench.whole import STAGES
from aw4d.io.files import replacing

LEAST = 1e-7  # an error that is drawn at the bottom of a logarithmic axis


def write_plots(found: Found, folder: Path) -> list[Path]:
    """Draw what was measured into bench_*.png; the paths of those that have something to show."""
    folder.mkdir(parents=True, exist_ok=True)
    drawers: dict[str, tuple[Callable[[Found, Any], None], object, tuple[float, float]]] = {
        "front": (_front, found.knobs, (12, 6.5)),
        "cost": (_cost, found.passes, (12, 4)),
        "passes": (_passes, found.passes, (9, 4.5)),
        "whole": (_whole, found.whole, (9, 3.5)),
    }
    return [_write(folder / f"bench_{k}.png", found, draw, size) for k, (draw, rows, size) in drawers.items() if rows]


def _write(path: Path, found: Found, draw: Callable[[Found, Any], None], size: tuple[float, float]) -> Path:
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    draw(found, figure)
    with replacing(path) as temporary:
        figure.savefig(temporary, format="png", dpi=90)
    return path


def _front(found: Found, figure: Any) -> None:
    """A panel a knob: filled the 99.99th percentile, hollow the mean; the front of each is a line."""
    knobs = list(dict.fromkeys(point.knob for point in found.knobs))
    panels = figure.subplots(2, -(-len(knobs) // 2), squeeze=False).ravel()
    for axes, knob in zip(panels, knobs, strict=False):
        points = [point for point in found.knobs if point.knob == knob]
        _curve(axes, points, "99.99th percentile, relative", lambda p: p.p9999_error, "C0", filled=True)
        _curve(axes, points, "mean, 8-bit codes", lambda p: p.mean_codes, "C1", filled=False)
        for p in points:
            at = p.time.median_ms, max(p.p9999_error, LEAST)
            weight = "bold" if p.default else "normal"
            axes.annotate(p.setting, at, (4, 4), textcoords="offset points", fontsize=7, weight=weight)
        axes.set(yscale="log", title=knob, xlabel=f"{points[0].step} [ms]", ylabel="error")
        axes.set_xlim(left=0)
    panels[0].legend(fontsize=7)
    for axes in panels[len(knobs) :]:
        axes.set_visible(False)


def _curve(
    axes: Any, points: list[Point], label: str, of: Callable[[Point], float], color: str, *, filled: bool
) -> None:
    at = [(p.time.median_ms, max(of(p), LEAST)) for p in points]
    best = sorted(one for one, on in zip(at, front(at), strict=True) if on)
    axes.plot(*zip(*best, strict=True), color=color, lw=1)
    face = color if filled else "none"
    axes.scatter(*zip(*at, strict=True), s=22, color=color, facecolors=face, label=label)


def _cost(found: Found, figure: Any) -> None:
    """Times over pixels, lights and particles, and a line of the cost that grows as they do."""
    pixels, lights, particles = figure.subplots(1, 3)
    device = found.limits[-1].device
    for step in dict.fromkeys(row.step for row in found.passes):
        rows = [r for r in found.passes if (r.step, r.device, r.scene) == (step, device, "street")]
        if rows:
            x = [row.width * row.height / 1e6 for row in rows]
            pixels.plot(x, [row.time.median_ms for row in rows], ".-", label=step)
    pixels.set(xscale="log", yscale="log", xlabel="megapixels", ylabel="ms", title=f"street, {device}")
    pixels.legend(fontsize=6)
    for axes, of in ((lights, "lights"), (particles, "particles")):
        seen = [point for point in found.costs if point.of == of]
        for key in dict.fromkeys((point.step, point.device) for point in seen):
            own = [point for point in seen if (point.step, point.device) == key]
            axes.plot([p.count for p in own], [p.time.median_ms for p in own], ".-", label=", ".join(key))
        axes.set(xscale="log", yscale="log", xlabel=of, ylabel="ms", title=f"cost by {of}")
        axes.legend(fontsize=6)


def _passes(found: Found, figure: Any) -> None:
    """A bar a pass and device, and the time that the limit would allow."""
    best = best_rows(found)
    size = best[0].width, best[0].height
    axes = figure.subplots()
    devices = [one.device for one in found.limits]
    places = np.arange(len(best))
    for i, device in enumerate(devices):
        rows = {r.step: r for r in found.passes if (r.device, r.scene, r.width, r.height) == (device, "street", *size)}
        shown = [rows[one.step] for one in best]
        left = places + (i - (len(devices) - 1) / 2) * 0.8 / len(devices)
        axes.bar(left, [r.time.median_ms for r in shown], 0.8 / len(devices), label=device)
        least = [r.time.median_ms * (r.share or 0) for r in shown]
        axes.scatter(left, least, marker="_", color="black", s=60, label="the limit" if i == 0 else None)
    axes.set(yscale="log", ylabel="ms", title=f"street, {size[0]}x{size[1]}")
    axes.set_xticks(places, [one.step for one in best], rotation=30, ha="right")
    axes.legend(fontsize=8)


def _whole(found: Found, figure: Any) -> None:
    """A stack of stages a weather, and the wall time of the edit and of decoding and encoding alone."""
    axes = figure.subplots()
    places = np.arange(len(found.whole))
    bottom = np.zeros(len(found.whole))
    for stage in STAGES:
        took = np.array([row.stages_ms[stage] for row in found.whole])
        axes.barh(places, took, left=bottom, label=stage)
        bottom += took
    edit = [row.edit_s / row.frames * 1e3 for row in found.whole]
    bare = [row.bare_s / row.frames * 1e3 for row in found.whole]
    axes.scatter(edit, places, marker="|", color="black", s=120, label="an edit, overlapping")
    axes.scatter(bare, places, marker="|", color="grey", s=120, label="decode and encode alone")
    axes.set_yticks(places, [row.weather for row in found.whole])
    axes.set(xlabel="ms a frame")
    axes.legend(fontsize=7)
